"""RateLimiter: control steps at a steady rate, and how well the machine keeps up."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

LATE_SHARE = 0.1
"""A step is late when it starts more than this share of a step after it was due."""
N_STEPS = 200
"""Number of newest steps that the timing describes."""


@dataclass(frozen=True, kw_only=True)
class LoopTiming:
    """Wall time of the last steps."""

    n_steps: int = 0
    mean_s: float = 0.0
    """Mean time from the start of a step to that of the next."""
    worst_s: float = 0.0
    late_share: float = 0.0
    """Share of steps that started late."""
    work_s: float = 0.0
    """Mean time of the simulation in a step."""

    def real_time_factor(self, step_s: float) -> float:
        """Return simulated over wall time; 0 where nothing was measured."""
        return step_s / self.mean_s if self.mean_s > 0 else 0.0

    def describe(self) -> str:
        """Return one line for a person."""
        if not self.n_steps:
            return "no steps yet"
        return (
            f"step {1000 * self.mean_s:.0f} ms mean, {1000 * self.worst_s:.0f} ms worst,"
            f" {100 * self.late_share:.0f} % late, {1000 * self.work_s:.0f} ms of it simulation"
        )


class RateLimiter:
    """Spaces steps of ``step_s`` of simulated time at ``speed`` times real time; 0 is as fast as possible.

    A machine that does not keep up slows the motion: a late step is never made up for by hurrying.
    """

    def __init__(
        self,
        step_s: float,
        speed: float = 1.0,
        *,
        n_steps: int | None = N_STEPS,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Describe the timing of the last ``n_steps`` steps; None: of all."""
        self._period_s = step_s / speed if speed > 0 else 0.0
        self._clock = clock
        self._sleep = sleep
        self._due: float | None = None
        self._lengths: deque[tuple[float, float]] = deque(maxlen=n_steps)
        """Length and lateness of each step, s."""
        self._work: deque[float] = deque(maxlen=n_steps)
        self._last: float | None = None

    def remaining_s(self) -> float:
        """Return the time until the next step is due; 0 where it is, or before the first one."""
        return 0.0 if self._due is None else max(self._due - self._clock(), 0.0)

    def start_step(self) -> None:
        """Wait until the next step is due, and start it."""
        remaining = self.remaining_s()
        if remaining > 0:
            self._sleep(remaining)
        now = self._clock()
        if self._last is not None:
            self._lengths.append((now - self._last, 0.0 if self._due is None else now - self._due))
        self._last = now
        late = self._due is not None and now - self._due > LATE_SHARE * self._period_s
        self._due = (now if late or self._due is None else self._due) + self._period_s

    def end_step(self) -> None:
        """Note that the step's work is done."""
        if self._last is not None:
            self._work.append(self._clock() - self._last)

    def pause(self) -> None:
        """Stop measuring until the next step, which is due at once."""
        self._due = self._last = None

    def timing(self) -> LoopTiming:
        """Return how the last steps went."""
        if not self._lengths:
            return LoopTiming()
        lengths = [length for length, _ in self._lengths]
        n_late = sum(behind > LATE_SHARE * self._period_s for _, behind in self._lengths)
        return LoopTiming(
            n_steps=len(lengths),
            mean_s=sum(lengths) / len(lengths),
            worst_s=max(lengths),
            late_share=n_late / len(lengths) if self._period_s else 0.0,
            work_s=sum(self._work) / max(len(self._work), 1),
        )
