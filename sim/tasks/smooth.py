"""The task ``smooth``: pull a crumpled cloth flat (chapter 3)."""

from __future__ import annotations

from layflat.data.environment_spec import StepLimits
from layflat.sim.tasks.base import Task

SMOOTH = Task(name="smooth", starts=("crumpled",), demonstrator="word", limits=StepLimits(place=60))
