"""RateLimiter: control steps at a steady rate, and how well the machine keeps up."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

LATE_SHARE = 0.1
"""A step is late when it starts more than this share of a step after it was due."""
N_STEPS = 200
"""Number of newest steps that are described."""


class RateLimiter:
    """Spaces steps of ``step_s`` of simulated time at ``speed`` times real time; 0 is as fast as possible.

    A machine that does not keep up slows the motion: a late step is never made up for by hurrying.
    """

    def __init__(self, step_s: float, speed: float = 1.0, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._step_s, self._period_s, self._clock = step_s, step_s / speed if speed > 0 else 0.0, clock
        self._due_s: float | None = None
        self._started_s: float | None = None
        self._lengths: deque[tuple[float, bool]] = deque(maxlen=N_STEPS)
        """Length of each step, s, and whether the next one started late."""
        self._work_s: deque[float] = deque(maxlen=N_STEPS)

    def remaining_s(self) -> float:
        """Return the time until the next step is due; 0 where it is, or before the first one."""
        return 0.0 if self._due_s is None else max(self._due_s - self._clock(), 0.0)

    def start_step(self) -> None:
        """Note that a step starts."""
        now = self._clock()
        late = self._due_s is not None and now - self._due_s > LATE_SHARE * self._period_s
        if self._started_s is not None:
            self._lengths.append((now - self._started_s, late and self._period_s > 0))
        self._started_s = now
        self._due_s = (now if late or self._due_s is None else self._due_s) + self._period_s

    def end_step(self) -> None:
        """Note that the step's work is done."""
        if self._started_s is not None:
            self._work_s.append(self._clock() - self._started_s)

    def pause(self) -> None:
        """Stop measuring until the next step, which is due at once."""
        self._due_s = self._started_s = None

    @property
    def real_time_factor(self) -> float:
        """Simulated over wall time of the last steps; 0 where nothing was measured."""
        total_s = sum(length for length, _ in self._lengths)
        return self._step_s * len(self._lengths) / total_s if total_s > 0 else 0.0

    def describe(self) -> str:
        """Return one line about the last steps."""
        if not self._lengths:
            return "no steps yet"
        lengths, late = zip(*self._lengths, strict=True)
        work_s = sum(self._work_s) / max(len(self._work_s), 1)
        return (
            f"step {1000 * sum(lengths) / len(lengths):.0f} ms mean, {1000 * max(lengths):.0f} ms worst,"
            f" {100 * sum(late) / len(late):.0f} % late, {1000 * work_s:.0f} ms of it simulation"
        )
