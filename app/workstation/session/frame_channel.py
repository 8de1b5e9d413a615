"""State of the simulation after each step, through shared memory to the window."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, field
from multiprocessing.context import BaseContext
from typing import Any

import numpy as np
from numpy.typing import NDArray

from layflat.app.workstation.session.latest_value import LatestValue
from layflat.data.arrays import FloatArray
from layflat.data.types import DragTarget
from layflat.perception.camera.table_grid import TableGrid
from layflat.perception.cloth.pipeline import ClothState
from layflat.policy.runner import EpisodeRunner
from layflat.sim.camera.camera import default_pinhole
from layflat.sim.simulation import ClothSimulation

_GRID = TableGrid()
_PINHOLE = default_pinhole()
_PLAIN = np.dtype(
    [
        ("episode", "i4"), ("step", "i4"), ("phase", "U10"), ("sim_s", "f8"), ("published_s", "f8"), ("input_s", "f8"),
        ("work_s", "f8"), ("cloth", "U24"), ("robot", "U16"), ("corners", "f8", (2, 3)), ("holder", "f8", 3),
        ("force_n", "f8", 3), ("word", "f8", 2), ("word_strength", "f8"), ("contact", "f8"), ("contact_true", "f8"),
        ("flat_area", "f8"), ("human_in_control", "?"),
    ]
)  # fmt: skip
"""Fields of SimulationFrame that are stored as they are."""
_SIZED = {"nodes": (400, 3), "joints": (14,), "hands": (16, 3)}
"""Largest shapes of the fields whose length varies; each has its length beside it."""
_OPTIONAL = np.dtype(
    [
        ("dragged_node", "i4"), ("drag_target", "f8", 3), ("has_image", "?"), ("coherence", "f8"), ("out_of_view", "?"),
        ("rgb", "u1", (_PINHOLE.height, _PINHOLE.width, 3)), ("cloth_mask", "?", (_GRID.height, _GRID.width)),
        ("contact_mask", "?", (_GRID.height, _GRID.width)),
    ]
)  # fmt: skip
_DTYPE = np.dtype(
    [
        *_PLAIN.descr,
        *((name, "f8", shape) for name, shape in _SIZED.items()),
        *((f"n_{name}", "i4") for name in _SIZED),
        *_OPTIONAL.descr,
    ]
)


@dataclass(frozen=True, kw_only=True, eq=False)
class SimulationFrame:
    """State at the end of a step; world frame, m, N, s."""

    episode: int
    """Number of the episode; the curves restart when it changes."""
    step: int
    phase: str
    sim_s: float
    robot: str
    cloth: str
    nodes: FloatArray
    """(N, 3)"""
    corners: FloatArray
    """Held corners, (2, 3)."""
    holder: FloatArray
    """Centre of what holds the cloth, (3,)."""
    joints: FloatArray
    """Angles of the arm, (J,) rad; empty where there is none."""
    published_s: float = 0.0
    """Time of publishing by the monotonic clock."""
    input_s: float = 0.0
    """Stamp of the input that acted in this step; 0 where none did."""
    work_s: float = 0.0
    """Wall time of the step."""
    hands: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    """Places where a disturbance holds the cloth, (K, 3)."""
    force_n: FloatArray = field(default_factory=lambda: np.zeros(3))
    """(3,)"""
    drag: DragTarget | None = None
    word: FloatArray = field(default_factory=lambda: np.zeros(2))
    """(2,)"""
    word_strength: float = 0.0
    contact: float = 0.0
    contact_true: float = 0.0
    flat_area: float = 0.0
    rgb: NDArray[np.uint8] | None = None
    """Image of the camera, (H, W, 3)."""
    cloth_state: ClothState | None = None
    """Output of the perception for that image."""
    human_in_control: bool = False
    """Whether a person, not the policy, decided the last step."""


class FrameChannel:
    """Newest frame of the simulation, for the window."""

    def __init__(self, context: BaseContext) -> None:
        self._value = LatestValue(context, _DTYPE)

    def publish(self, sim: ClothSimulation, run: EpisodeRunner, *, input_s: float = 0.0, work_s: float = 0.0) -> None:
        """Write the state after the last step of an episode that has a process of its own."""
        seen, truth = run.observation, run.ground_truth
        state = sim.cloth_state
        has_image = seen.rgb is not None and state is not None and state.cloth_mask.shape == (_GRID.height, _GRID.width)
        self.write(
            SimulationFrame(
                episode=os.getpid(),
                step=run.n_steps,
                phase=run.steps[-1].phase if run.steps else "place",
                sim_s=seen.time_s,
                published_s=time.monotonic(),
                input_s=input_s,
                work_s=work_s,
                robot=run.env.spec.robot.name,
                cloth=run.env.spec.cloth,
                nodes=np.zeros((0, 3)) if truth is None else truth.nodes,
                corners=seen.corner_positions,
                holder=seen.holder_position,
                joints=sim.joint_angles(),
                hands=sim.hand_positions()[: _SIZED["hands"][0]],
                force_n=sim.force_n(),
                drag=sim.drag_target,
                word=seen.word,
                word_strength=seen.word_strength,
                contact=seen.contact_portion,
                contact_true=0.0 if truth is None else truth.contact_portion_true,
                flat_area=0.0 if truth is None else truth.flat_area,
                rgb=seen.rgb if has_image else None,
                cloth_state=state if has_image else None,
                human_in_control=bool(run.steps) and run.steps[-1].intervention,
            )
        )

    def write(self, frame: SimulationFrame) -> None:
        """Replace the newest frame."""
        values = {name: getattr(frame, name) for name in _PLAIN.names or ()}
        for name, shape in _SIZED.items():
            array = getattr(frame, name)
            values[name] = np.zeros(shape)
            values[name][: len(array)] = array
            values[f"n_{name}"] = len(array)
        drag, state = frame.drag, frame.cloth_state
        values |= {
            "dragged_node": -1 if drag is None else drag.node,
            "drag_target": np.zeros(3) if drag is None else drag.target_m,
            "has_image": frame.rgb is not None and state is not None,
        }
        if frame.rgb is not None and state is not None:
            values["rgb"] = frame.rgb
            values |= {n: getattr(state, n) for n in ("cloth_mask", "contact_mask", "coherence", "out_of_view")}
        self._value.write(**values)

    def read(self, after: int = 0) -> tuple[int, SimulationFrame] | None:
        """Return the newest frame and its number, or None where there is none newer than number ``after``."""
        found = self._value.read(after)
        return None if found is None else (found[0], _frame(found[1]))


def _frame(value: np.void) -> SimulationFrame:
    plain = {name: value[name] for name in _PLAIN.names or ()}
    fields: dict[str, Any] = {n: item if isinstance(item, np.ndarray) else item.item() for n, item in plain.items()}
    fields |= {name: value[name][: int(value[f"n_{name}"])] for name in _SIZED}
    node = int(value["dragged_node"])
    return SimulationFrame(
        **fields,
        drag=None if node < 0 else DragTarget(node=node, target_m=value["drag_target"]),
        rgb=value["rgb"] if value["has_image"] else None,
        cloth_state=_cloth_state(value) if value["has_image"] else None,
    )


def _cloth_state(value: np.void) -> ClothState:
    return ClothState(
        grid=_GRID,
        cloth_mask=value["cloth_mask"],
        contact_mask=value["contact_mask"],
        cloth_pixels=int(np.count_nonzero(value["cloth_mask"])),
        contact_pixels=int(np.count_nonzero(value["contact_mask"])),
        contact_portion=float(value["contact"]),
        word=value["word"],
        coherence=float(value["coherence"]),
        strength=float(value["word_strength"]),
        out_of_view=bool(value["out_of_view"]),
    )
