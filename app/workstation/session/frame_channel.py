"""State of the simulation after each step, through shared memory to the window."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from layflat.data.arrays import FloatArray
from layflat.data.types import DragTarget
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.cloth.pipeline import ClothState
from layflat.policy.runner import EpisodeRunner
from layflat.sim.camera.camera import default_pinhole
from layflat.sim.simulation import ClothSimulation

FRAME_BYTES = 4_000_000
"""Largest frame: camera image, masks and meshes of any size take a quarter of it."""


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
    pinhole: PinholeCamera = field(default_factory=default_pinhole)
    """Camera of the image."""
    human_in_control: bool = False
    """Whether a person, not the policy, decided the last step."""


def frame_of(sim: ClothSimulation, run: EpisodeRunner, *, input_s: float, work_s: float) -> SimulationFrame:
    """Return the state after the last step of an episode that has a process of its own."""
    seen, truth, state = run.observation, run.ground_truth, sim.cloth_state
    has_image = seen.rgb is not None and state is not None
    return SimulationFrame(
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
        hands=sim.hand_positions(),
        force_n=sim.force_n(),
        drag=sim.drag_target,
        word=seen.word,
        word_strength=seen.word_strength,
        contact=seen.contact_portion,
        contact_true=0.0 if truth is None else truth.contact_portion_true,
        flat_area=0.0 if truth is None else truth.flat_area,
        rgb=seen.rgb if has_image else None,
        cloth_state=state if has_image else None,
        pinhole=sim.pinhole,
        human_in_control=bool(run.steps) and run.steps[-1].intervention,
    )
