"""Task: what the robot has to achieve, from which start, and within how many steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from layflat.data.environment_spec import StepLimits
from layflat.data.types import FLAT_AREA, GroundTruth


def lies_flat(ground_truth: GroundTruth) -> bool:
    """Whether the cloth lies flat on the table, face up."""
    return ground_truth.flat_area > FLAT_AREA


@dataclass(frozen=True, kw_only=True)
class Task:
    """One task of a robot with a cloth."""

    name: str
    starts: tuple[str, ...]
    """Names of the starts that belong to the task, in `layflat.sim.starts.registry`; the first is the default."""
    demonstrator: str
    """Name of the policy or controller that demonstrates the task."""
    limits: StepLimits = field(default_factory=StepLimits)
    """Step limits of an episode's phases."""
    is_success: Callable[[GroundTruth], bool] = field(default=lies_flat)
    """Whether an episode that ends like this is a success."""
