"""Episodes, steps and observations: frozen, validated, read-only values shared by every package.

World frame: z up, table top at z = 0, x to the robot's front, y to its left. Metres, seconds, newtons,
radians. Simulated time is the clock.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from layflat.data.arrays import FloatArray, frozen_array
from layflat.data.camera import CameraModel
from layflat.data.errors import DataError
from layflat.data.names import storable
from layflat.data.robot import RobotSpec

Phase: TypeAlias = Literal["place", "disturb", "repair"]
StoppedBy: TypeAlias = Literal["converged", "threshold", "step_limit", "unstable", "interrupted", "crashed"]
Outcome: TypeAlias = Literal["success", "failure", "partial"]

PHASES: tuple[Phase, ...] = ("place", "disturb", "repair")
STOP_REASONS: tuple[StoppedBy, ...] = ("converged", "threshold", "step_limit", "unstable", "interrupted", "crashed")
OUTCOMES: tuple[Outcome, ...] = ("success", "failure", "partial")

ACTION_LIMIT_M = 0.02
"""Largest displacement along one axis in one step; files and gymnasium store action / ACTION_LIMIT_M in [-1, 1]."""

FLAT_AREA = 0.97
"""A demonstration or placement is a success when its flat area ends above this."""

DESCRIPTORS = ("word", "word-axial", "how", "hog")
"""Names of the descriptors that may compute Observation.word."""

STEP_S = 0.1
"""Simulated time of one control step."""


def frozen_hand(value: ArrayLike) -> FloatArray:
    """Return the place of a guiding hand, (3,) m, or of one for each point, (2, 3) m, read-only."""
    return frozen_array(value, (3,) if np.ndim(value) == 1 else (2, 3), "hand")


@dataclass(frozen=True, kw_only=True)
class Observation:
    """The data that a policy may see at the start of a step."""

    time_s: float
    """Simulated time since the episode's first step."""
    corner_positions: FloatArray
    """(2, 3) m, world: positions where the robot holds the two corners; row 0 at +y, row 1 at -y."""
    holder_position: FloatArray
    """(3,) m, world: centre of the robot's holder, or the midpoint of its two points."""
    word: FloatArray
    """(2,) unit vector in table coordinates (x, y) with x >= 0, or zeros where there is no direction."""
    word_strength: float
    """>= 0; 0 where there is no direction."""
    contact_portion: float
    """Eq. 4-7 from the camera, contact pixels / flat cloth's pixels; noise may take it slightly above 1."""
    rgb: NDArray[np.uint8] | None = None
    """(H, W, 3) camera image."""
    depth: NDArray[np.float32] | None = None
    """(H, W) m along the optical axis; 0 where the sensor has no value."""
    free_edge_m: FloatArray | None = None
    """(3,) m, world: mean place of the lowest twentieth of the cloth that the camera sees; of a hanging cloth its free
    edge. For the policy of now: files do not keep it."""

    def __post_init__(self) -> None:
        _set(self, "corner_positions", frozen_array(self.corner_positions, (2, 3), "corner_positions"))
        _set(self, "holder_position", frozen_array(self.holder_position, (3,), "holder_position"))
        _set(self, "word", frozen_array(self.word, (2,), "word"))
        if not np.isfinite([self.time_s, self.word_strength, self.contact_portion]).all():
            raise DataError("time_s, word_strength and contact_portion must be finite")
        if self.rgb is not None:
            _set(self, "rgb", frozen_array(self.rgb, (None, None, 3), "rgb", np.uint8))
        if self.depth is not None:
            _set(self, "depth", frozen_array(self.depth, (None, None), "depth", np.float32))
        if self.free_edge_m is not None:
            _set(self, "free_edge_m", frozen_array(self.free_edge_m, (3,), "free_edge_m"))


@dataclass(frozen=True, kw_only=True)
class GroundTruth:
    """The data that only a simulator knows; no learned policy sees it."""

    nodes: FloatArray
    """(N, 3) m, world: cloth nodes, row-major grid."""
    contact_portion_true: float
    """Share of the cloth's area at rest that rests on the table, 0..1."""
    flat_area: float
    """Signed projected area of the triangles on the table / cloth area; a part on its reverse side counts negative."""

    def __post_init__(self) -> None:
        _set(self, "nodes", frozen_array(self.nodes, (None, 3), "nodes"))
        if not np.isfinite([self.contact_portion_true, self.flat_area]).all():
            raise DataError("contact_portion_true and flat_area must be finite")


@dataclass(frozen=True, kw_only=True)
class DragTarget:
    """Target of a person who drags the cloth in one step."""

    node: int
    """Cloth node that is dragged."""
    target_m: FloatArray
    """(3,) m, world: target at the end of the step; the node may lag behind, since the force is bounded."""

    def __post_init__(self) -> None:
        _set(self, "target_m", frozen_array(self.target_m, (3,), "target_m"))
        if self.node < 0:
            raise DataError(f"the dragged node is {self.node}; it must be at least 0")


@dataclass(frozen=True, kw_only=True)
class DisturbanceRecord:
    """One disturbance of the cloth, with its random parameters."""

    name: str
    first_step: int
    """First step in which it acts; 0 also where it started in steps that were cut off."""
    last_step: int | None = None
    """Last step of it, coming to rest included; None where the episode ended before."""
    plan: Mapping[str, Any] = field(default_factory=dict)
    """JSON values by name: place, path, strength; empty where only its name and the seed are known."""

    def __post_init__(self) -> None:
        if self.first_step < 0 or (self.last_step is not None and self.last_step < self.first_step):
            raise DataError(
                f"disturbance {self.name} lasts from step {self.first_step} to {self.last_step};"
                " it must begin at 0 or later, and end no earlier than it begins"
            )


@dataclass(frozen=True, kw_only=True)
class Step:
    """One control step: observation, action and phase."""

    observation: Observation
    ground_truth: GroundTruth | None = None
    action: FloatArray
    """(A,) m per step, in the order of the robot's axes."""
    action_std: FloatArray | None = None
    """(A,) m, standard deviation of the policy's prediction, if it has one."""
    phase: Phase = "place"
    drag: DragTarget | None = None
    """Target of a person who dragged the cloth."""
    force_n: FloatArray = field(default_factory=lambda: np.zeros(3))
    """(3,) N, world: mean total force of disturbances and dragging on the cloth in this step."""
    intervention: bool = False
    """Whether a person decided although a policy is in control."""
    hand_m: FloatArray | None = None
    """(3,) m, or (2, 3) m for a robot with two points, world: target of a person who guided it by hand; ``action``
    is the resulting displacement."""

    def __post_init__(self) -> None:
        if self.hand_m is not None:
            _set(self, "hand_m", frozen_hand(self.hand_m))
        _set(self, "force_n", frozen_array(self.force_n, (3,), "force_n"))
        _set(self, "action", frozen_array(self.action, (None,), "action"))
        if self.action_std is not None:
            _set(self, "action_std", frozen_array(self.action_std, self.action.shape, "action_std"))
        if self.phase not in PHASES:
            raise DataError(f"phase is {self.phase!r}; it must be one of {', '.join(PHASES)}")


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Origin of an episode: versions, platform, time, command, operator."""

    versions: Mapping[str, str] = field(default_factory=dict)
    """Package name -> version (layflat, pybullet, numpy, python, ...)."""
    platform: str = ""
    created_utc: str = ""
    """Time of the machine's clock, which may jump: for people only, nothing is ordered by it."""
    command: str = ""
    operator: str = ""
    """Person who demonstrated, or who ran the program."""

    def __post_init__(self) -> None:
        for name in ("platform", "command", "operator"):
            object.__setattr__(self, name, storable(str(getattr(self, name))))


@dataclass(frozen=True, kw_only=True)
class Episode:
    """One attempt at a task, from the start to the stop."""

    robot: RobotSpec
    cloth: str
    seed: int
    source: str
    """Source of the actions: gamepad, keyboard, mouse, kinesthetic, scripted, or a policy's name."""
    steps: tuple[Step, ...]
    final_observation: Observation
    final_ground_truth: GroundTruth | None
    stopped_by: StoppedBy
    outcome: Outcome
    step_s: float = STEP_S
    disturbance: str = "none"
    """Name of the disturbance, or of the suite of them; or "none"."""
    wall_s: float = 0.0
    decision_s: float | None = None
    """Mean wall time of a decision of the policy; None where it is not known."""
    start: Mapping[str, float] = field(default_factory=dict)
    """Random parameters of the start, by name (friction, mass, hem side, ...)."""
    provenance: Provenance = field(default_factory=Provenance)
    task: str = "place"
    """Name of the task: place, smooth, ..."""
    physics: str = "bullet"
    """Name of the simulator; "real" for a real robot."""
    descriptor: str = "word"
    """Descriptor that computed Observation.word: one of DESCRIPTORS."""
    sim_config: Mapping[str, str | float | bool] = field(default_factory=dict)
    """Settings of the simulation, by name: with robot, cloth, seed and step_s they reproduce the start."""
    initial_joints: FloatArray = field(default_factory=lambda: np.zeros(0))
    """(J,) rad: joints of the arm before the first step; empty where no arm holds the cloth."""
    disturbances: tuple[DisturbanceRecord, ...] = ()
    """Disturbances in their order; dragging by a person is in the steps."""
    first_step: int = 0
    """Number of steps that were cut off before the first one; action replay needs 0."""
    camera: CameraModel | None = None
    """Camera that the observations come from; None where it is not known, or there is none."""
    mesh_shape: tuple[int, int] | None = None
    """Rows and columns of the ground truth's nodes, the free edge first; None without ground truth."""

    def __post_init__(self) -> None:
        _set(self, "steps", tuple(self.steps))
        _set(self, "disturbances", tuple(self.disturbances))
        if not isinstance(self.robot, RobotSpec):
            raise DataError(f"robot is {self.robot!r}; it must be a RobotSpec")
        if self.stopped_by not in STOP_REASONS:
            raise DataError(f"stopped_by is {self.stopped_by!r}; it must be one of {', '.join(STOP_REASONS)}")
        if self.outcome not in OUTCOMES:
            raise DataError(f"outcome is {self.outcome!r}; it must be one of {', '.join(OUTCOMES)}")
        if self.descriptor not in DESCRIPTORS:
            raise DataError(f"descriptor is {self.descriptor!r}; it must be one of {', '.join(DESCRIPTORS)}")
        if self.first_step < 0:
            raise DataError(f"first_step is {self.first_step}; it must be at least 0")
        _set(self, "initial_joints", frozen_array(self.initial_joints, (None,), "initial_joints"))
        for record in self.disturbances if self.steps else ():
            if max(record.first_step, record.last_step or 0) >= len(self.steps):
                raise DataError(f"disturbance {record.name} is not within the episode's {len(self.steps)} steps")
        size = self.robot.size
        for step_index, step in enumerate(self.steps):
            if step.action.shape != (size,):
                raise DataError(
                    f"step {step_index}: action has shape {step.action.shape}; robot {self.robot} needs ({size},)"
                )

    @property
    def contact_final(self) -> float:
        """Camera's contact portion after the last step, at most 1."""
        return min(1.0, self.final_observation.contact_portion)

    @property
    def flat_area_final(self) -> float | None:
        """Signed flat area of the mesh after the last step; None where there is no ground truth."""
        return None if self.final_ground_truth is None else self.final_ground_truth.flat_area

    def observations(self) -> tuple[Observation, ...]:
        """Return the observation at the start of each step and the one after the last: len(steps) + 1."""
        return (*(step.observation for step in self.steps), self.final_observation)

    def ground_truths(self) -> tuple[GroundTruth, ...]:
        """Return the ground truth at the times of `observations`; DataError for an episode that has none."""
        found = [*(step.ground_truth for step in self.steps), self.final_ground_truth]
        known = tuple(item for item in found if item is not None)
        if len(known) != len(found):
            raise DataError("the episode has no ground truth: it does not come from a simulator")
        return known

    def contact(self) -> FloatArray:
        """Return the camera's contact portion over time, (len(steps) + 1,)."""
        return np.array([o.contact_portion for o in self.observations()])

    def phase_bounds(self, phase: Phase) -> tuple[int, int] | None:
        """Return the first step of a phase and the step after its last, or None where the episode has no such phase."""
        indices = [index for index, step in enumerate(self.steps) if step.phase == phase]
        return (indices[0], indices[-1] + 1) if indices else None

    @property
    def unstable(self) -> bool:
        """Whether the simulation diverged."""
        return self.stopped_by == "unstable"


def disturbances_within(records: Sequence[DisturbanceRecord], start: int, stop: int) -> tuple[DisturbanceRecord, ...]:
    """Return the disturbances within the steps ``start`` to ``stop - 1``, counted from ``start``."""
    return tuple(
        replace(
            record,
            first_step=max(record.first_step - start, 0),
            last_step=None if record.last_step is None or record.last_step >= stop else record.last_step - start,
        )
        for record in records
        if record.first_step < stop and (record.last_step is None or record.last_step >= start)
    )


def actions_of(steps: Sequence[Step]) -> FloatArray:
    """Return the actions, (T, A) m per step."""
    return np.array([step.action for step in steps])


def _set(instance: object, name: str, value: object) -> None:
    """Assign inside __post_init__ of a frozen dataclass."""
    object.__setattr__(instance, name, value)
