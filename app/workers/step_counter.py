"""StepCounter: steps of a work item, counted in its processes and read by their parent."""

from __future__ import annotations

import mmap
from collections.abc import Sequence

from layflat.data.types import DisturbanceRecord, Step
from layflat.policy.runner import DisturbanceCallback, StepCallback


class StepCounter:
    """A number in memory that a process shares with those that are forked from it; a callback of the rollout."""

    def __init__(self) -> None:
        self._memory = memoryview(mmap.mmap(-1, mmap.PAGESIZE)).cast("q")

    @property
    def steps(self) -> int:
        """Number of steps, of all cases."""
        return int(self._memory[0])

    def on_step(self, step: Step, step_index: int) -> None:
        """Count a step."""
        self._memory[0] += 1


class CountedCallback:
    """A callback whose steps are counted."""

    def __init__(self, callback: StepCallback, counter: StepCounter) -> None:
        self._callback = callback
        self._counter = counter

    def on_step(self, step: Step, step_index: int) -> None:
        """Count a step, and pass it on."""
        self._counter.on_step(step, step_index)
        self._callback.on_step(step, step_index)

    def on_disturbance(self, records: Sequence[DisturbanceRecord]) -> None:
        """Pass the disturbances on."""
        if isinstance(self._callback, DisturbanceCallback):
            self._callback.on_disturbance(records)
