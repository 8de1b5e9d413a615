"""Task: what the robot has to achieve, from which start, and within how many steps; and every task by its name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from layflat.data.environment_spec import StepLimits
from layflat.data.types import FLAT_AREA, GroundTruth


@dataclass(frozen=True, kw_only=True)
class Task:
    """One task of a robot with a cloth; a subclass may have another `is_success`."""

    name: str
    starts: tuple[str, ...]
    """Names of the starts that belong to the task, in `layflat.sim.starts.registry`; the first is the default."""
    quick_start: str | None = None
    """Name of the start that a learner begins with, as it needs many; None: the default."""
    demonstrator: str
    """Name of the policy that ``scripted`` stands for in this task."""
    instruction: str = "Lay the {cloth} flat on the table with the {robot}."
    """Task in words, for policies that are conditioned on language."""
    limits: StepLimits = field(default_factory=StepLimits)
    """Step limits of an episode's phases."""

    def is_success(self, ground_truth: GroundTruth) -> bool:
        """Whether the cloth lies flat on the table, face up."""
        return ground_truth.flat_area > FLAT_AREA


PLACE = Task(
    name="place",
    starts=("hanging", "hanging-quick", "folded-corner", "swinging", "crumpled"),
    demonstrator="scripted",
    quick_start="hanging-quick",
)
"""Lay a cloth flat on the table (chapter 4)."""
SMOOTH = Task(
    name="smooth",
    starts=("crumpled",),
    demonstrator="word",
    instruction="Smooth the crumpled {cloth} on the table with the {robot}.",
    limits=StepLimits(place=60),
)
"""Pull a crumpled cloth flat (chapter 3)."""
TASKS: Mapping[str, Task] = {task.name: task for task in (PLACE, SMOOTH)}
DEFAULT_TASK = PLACE.name
