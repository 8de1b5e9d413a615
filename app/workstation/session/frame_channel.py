"""What the bench shows of itself after each step, and its way through shared memory to the window."""

from __future__ import annotations

import time
from dataclasses import dataclass
from multiprocessing.context import BaseContext
from typing import Any

import numpy as np
from numpy.typing import NDArray

from layflat.app.workstation.session.latest_value import LatestValue
from layflat.data.arrays import FloatArray
from layflat.data.types import GroundTruth, Observation
from layflat.perception.camera.table_grid import TableGrid
from layflat.perception.cloth.pipeline import ClothState
from layflat.sim.camera.camera import default_pinhole
from layflat.sim.simulation import ClothSimulation

NODES_MAX = 400
HANDS_MAX = 16
JOINTS_MAX = 7
_GRID = TableGrid()
_PINHOLE = default_pinhole()
_DTYPE = np.dtype(
    [
        ("episode", "i4"), ("step", "i4"), ("phase", "U10"), ("sim_s", "f8"), ("told_s", "f8"), ("input_s", "f8"),
        ("work_s", "f8"), ("cloth", "U24"), ("robot", "U10"), ("node_count", "i4"), ("nodes", "f4", (NODES_MAX, 3)),
        ("corners", "f8", (2, 3)), ("holder", "f8", 3), ("joint_count", "i4"), ("joints", "f8", JOINTS_MAX),
        ("hand_count", "i4"), ("hands", "f8", (HANDS_MAX, 3)), ("force", "f8", 3), ("pulled", "i4"),
        ("pull_target", "f8", 3), ("word", "f8", 2), ("strength", "f8"), ("contact", "f8"), ("contact_true", "f8"),
        ("flat_area", "f8"), ("has_image", "?"), ("rgb", "u1", (_PINHOLE.height, _PINHOLE.width, 3)),
        ("cloth_mask", "?", (_GRID.height, _GRID.width)), ("contact_mask", "?", (_GRID.height, _GRID.width)),
        ("coherence", "f8"), ("out_of_view", "?"), ("led", "?"),
    ]
)  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class BenchFrame:
    """The bench at the end of a step; world frame, m, N, s."""

    episode: int
    """Counts the episodes of one bench process: with a new one, curves begin anew."""
    step: int
    phase: str
    sim_s: float
    told_s: float
    """When it was told, by the monotonic clock."""
    input_s: float
    """Stamp of the input that acted in this step; 0 where none did."""
    work_s: float
    """Wall time that the step took."""
    robot: str
    cloth: str
    nodes: FloatArray
    """(N, 3)"""
    corners: FloatArray
    """(2, 3)"""
    holder: FloatArray
    """(3,)"""
    joints: FloatArray
    """(7,) rad, or none where no arm holds the cloth."""
    hands: FloatArray
    """(K, 3)"""
    force_n: FloatArray
    """(3,)"""
    pull: tuple[int, FloatArray] | None
    """The node that is pulled at, and where to."""
    word: FloatArray
    """(2,)"""
    strength: float
    contact: float
    contact_true: float
    flat_area: float
    rgb: NDArray[np.uint8] | None
    """(H, W, 3) of the bench's camera."""
    cloth_state: ClothState | None
    """What perception made of it."""
    led: bool = False
    """A person had the lead over a policy in the step that led here."""


class FrameChannel:
    """The bench's newest moment, for the window."""

    def __init__(self, context: BaseContext) -> None:
        self._value = LatestValue(context, _DTYPE)

    def tell(
        self,
        bench: ClothSimulation,
        seen: Observation,
        ground_truth: GroundTruth,
        *,
        episode: int,
        step: int,
        phase: str,
        input_s: float = 0.0,
        work_s: float = 0.0,
        led: bool = False,
    ) -> None:
        """Called by the bench after each step."""
        fields = _holding(bench) | _seeing(bench, seen)
        nodes = np.zeros((NODES_MAX, 3), np.float32)
        nodes[: len(ground_truth.nodes)] = ground_truth.nodes
        self._value.write(
            episode=episode,
            step=step,
            phase=phase,
            sim_s=seen.time_s,
            told_s=time.monotonic(),
            input_s=input_s,
            work_s=work_s,
            cloth=bench.spec.cloth,
            robot=bench.spec.robot.name,
            node_count=len(ground_truth.nodes),
            nodes=nodes,
            corners=seen.corner_positions,
            holder=seen.holder_position,
            force=bench.force_n(),
            word=seen.word,
            strength=seen.word_strength,
            contact=seen.contact_portion,
            contact_true=ground_truth.contact_portion_true,
            flat_area=ground_truth.flat_area,
            led=led,
            **fields,
        )

    def read(self, after: int = 0) -> tuple[int, BenchFrame] | None:
        """The newest moment and its number; None where there is none newer than number ``after``."""
        found = self._value.read(after)
        return None if found is None else (found[0], _moment(found[1]))


def _holding(bench: ClothSimulation) -> dict[str, Any]:
    """Joints, hands and pull."""
    joints, hands = np.zeros(JOINTS_MAX), np.zeros((HANDS_MAX, 3))
    angles = bench.joint_angles()
    joints[: len(angles)] = angles
    places = bench.hand_positions()[:HANDS_MAX]
    hands[: len(places)] = places
    pull = bench.drag_target
    return {
        "joint_count": len(angles),
        "joints": joints,
        "hand_count": len(places),
        "hands": hands,
        "pulled": -1 if pull is None else pull.node,
        "pull_target": np.zeros(3) if pull is None else pull.target_m,
    }


def _seeing(bench: ClothSimulation, seen: Observation) -> dict[str, Any]:
    """The camera's image and what perception made of it."""
    cloth_state = bench.cloth_state
    if seen.rgb is None or cloth_state is None or cloth_state.cloth_mask.shape != (_GRID.height, _GRID.width):
        return {"has_image": False}
    return {
        "has_image": True,
        "rgb": seen.rgb,
        "cloth_mask": cloth_state.cloth_mask,
        "contact_mask": cloth_state.contact_mask,
        "coherence": cloth_state.coherence,
        "out_of_view": cloth_state.out_of_view,
    }


def _moment(value: np.void) -> BenchFrame:
    return BenchFrame(
        episode=int(value["episode"]),
        step=int(value["step"]),
        phase=str(value["phase"]),
        sim_s=float(value["sim_s"]),
        told_s=float(value["told_s"]),
        input_s=float(value["input_s"]),
        work_s=float(value["work_s"]),
        robot=str(value["robot"]),
        cloth=str(value["cloth"]),
        nodes=value["nodes"][: int(value["node_count"])].astype(float),
        corners=value["corners"],
        holder=value["holder"],
        joints=value["joints"][: int(value["joint_count"])],
        hands=value["hands"][: int(value["hand_count"])],
        force_n=value["force"],
        pull=None if value["pulled"] < 0 else (int(value["pulled"]), value["pull_target"]),
        word=value["word"],
        strength=float(value["strength"]),
        contact=float(value["contact"]),
        contact_true=float(value["contact_true"]),
        flat_area=float(value["flat_area"]),
        rgb=value["rgb"] if value["has_image"] else None,
        cloth_state=_cloth_state(value) if value["has_image"] else None,
        led=bool(value["led"]),
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
        strength=float(value["strength"]),
        out_of_view=bool(value["out_of_view"]),
    )
