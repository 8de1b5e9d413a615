"""EnvironmentSpec: what an environment is, for policies, recorders and files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from layflat.data.camera import CameraModel
from layflat.data.robot import RobotSpec
from layflat.data.types import STEP_S


@dataclass(frozen=True, kw_only=True)
class ClothShape:
    """The size of a cloth as it lies flat, and its mesh."""

    length_m: float
    """From the free edge to the held edge."""
    width_m: float
    """Along the held edge."""
    held_width_m: float
    """Distance at which a robot holds the two corners."""
    rows: int
    columns: int
    """Nodes of the ground truth: ``rows`` x ``columns``, the free edge first."""


@dataclass(frozen=True, kw_only=True)
class StepLimits:
    """Most control steps of each phase of an episode."""

    place: int = 160
    repair: int = 80
    disturb: int = 60
    """A disturbance that is not over by then is cut off."""


@dataclass(frozen=True, kw_only=True)
class EnvironmentSpec:
    """Properties of an environment that policies and recorders need before it starts."""

    robot: RobotSpec
    cloth: str
    """Name of the cloth."""
    task: str = "place"
    demonstrator: str = "scripted"
    """Name of the built-in policy that ``scripted`` stands for in the task."""
    physics: str = "bullet"
    descriptor: str = "word"
    """What the observations' WORD comes from."""
    step_s: float = STEP_S
    """Duration of a control step, s."""
    limits: StepLimits = StepLimits()
    """Step limits of the task."""
    cloth_shape: ClothShape | None = None
    """None for a cloth that has not been measured."""
    camera: CameraModel | None = None
    """Camera that the observations come from; None where it is not known, or there is none."""
    config: Mapping[str, str | float | bool] = field(default_factory=dict)
    """Further settings, by name, that make the same environment again."""
