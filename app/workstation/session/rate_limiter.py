"""Steady time: steps begin when they are due by the wall's clock, where the machine keeps up, and how well they do."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

LATE_SHARE = 0.1
"""A step is late when it begins more than this share of a step after it was due."""
MEMORY = 200
"""Steps that the cadence is told of."""


@dataclass(frozen=True, kw_only=True)
class LoopTiming:
    """How the last steps went, in wall time."""

    n_steps: int = 0
    mean_s: float = 0.0
    """From the beginning of a step to that of the next."""
    worst_s: float = 0.0
    late: float = 0.0
    """Share of steps that began late."""
    work_s: float = 0.0
    """Mean time that the simulation itself took of a step."""

    def factor(self, step_s: float) -> float:
        """Simulated over wall time; 0 where nothing was measured."""
        return step_s / self.mean_s if self.mean_s > 0 else 0.0

    def told(self) -> str:
        """One line for a person."""
        if not self.n_steps:
            return "no steps yet"
        return (
            f"step {1000 * self.mean_s:.0f} ms mean, {1000 * self.worst_s:.0f} ms worst, {100 * self.late:.0f} % late,"
            f" {1000 * self.work_s:.0f} ms of it simulation"
        )


class RateLimiter:
    """Paces steps of ``step_s`` of simulated time at ``speed`` times real time; 0 is as fast as it goes.

    A machine that does not keep up slows the motion: what is late is never made up for by hurrying. ``memory`` is how
    many steps the rhythm is told of; None: all.
    """

    def __init__(
        self,
        step_s: float,
        speed: float = 1.0,
        *,
        memory: int | None = MEMORY,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._pitch_s = step_s / speed if speed > 0 else 0.0
        self._clock = clock
        self._sleep = sleep
        self._due: float | None = None
        self._began: deque[tuple[float, float]] = deque(maxlen=memory)
        """Length and lateness of each step, s."""
        self._work: deque[float] = deque(maxlen=memory)
        self._last: float | None = None

    def left_s(self) -> float:
        """Time until the next step is due; 0 where it is, or where none has been."""
        return 0.0 if self._due is None else max(self._due - self._clock(), 0.0)

    def begin(self) -> None:
        """Wait until the next step is due, and begin it."""
        left = self.left_s()
        if left > 0:
            self._sleep(left)
        now = self._clock()
        if self._last is not None:
            self._began.append((now - self._last, 0.0 if self._due is None else now - self._due))
        self._last = now
        late = self._due is not None and now - self._due > LATE_SHARE * self._pitch_s
        self._due = (now if late or self._due is None else self._due) + self._pitch_s

    def end(self) -> None:
        """The step's work is done."""
        if self._last is not None:
            self._work.append(self._clock() - self._last)

    def pause(self) -> None:
        """No steps for a while, which is nobody's fault."""
        self._due = self._last = None

    def rhythm(self) -> LoopTiming:
        if not self._began:
            return LoopTiming()
        lengths = [length for length, _ in self._began]
        late = [behind for _, behind in self._began if behind > LATE_SHARE * self._pitch_s]
        return LoopTiming(
            n_steps=len(lengths),
            mean_s=sum(lengths) / len(lengths),
            worst_s=max(lengths),
            late=len(late) / len(lengths) if self._pitch_s else 0.0,
            work_s=sum(self._work) / max(len(self._work), 1),
        )
