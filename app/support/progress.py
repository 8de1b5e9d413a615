"""Progress on stderr: the current phase and item of a command, and the expected time left.

On a terminal a bar, elsewhere plain lines: one at each phase and each finished item, and at most one every few seconds
in between.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import TextIO

from rich.console import Console
from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as RichProgress

PLAIN_INTERVAL_S = 5.0
TRUST_AFTER_SHARE = 0.02
"""Share of the expected time after which the measured speed counts instead of the expected one."""


class Progress:
    """Progress over phases whose weights are their expected durations in seconds.

    >>> with Progress({"demonstrations": 60, "training": 20}) as progress:
    ...     progress.phase("demonstrations", items=5)
    ...     progress.status("seed 3: dragging")  # what happens inside an item
    ...     progress.advance()                   # an item is finished; 0.1 is a tenth of one
    ...     progress.note("kept demo_3")         # a line that stays
    """

    def __init__(
        self,
        phases: Mapping[str, float],
        *,
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
        interval_s: float = PLAIN_INTERVAL_S,
    ) -> None:
        """``phases``: weights in seconds, each above 0; ``stream``: stderr by default."""
        if not phases or min(phases.values()) <= 0:
            raise ValueError(f"phases are {dict(phases)}; at least one is needed, each with a weight above 0")
        self._weights = dict(phases)
        self._stream = stream if stream is not None else sys.stderr
        self._clock = clock
        self._interval_s = interval_s
        self._began_s = clock()
        self._spoke_s = -float("inf")
        self._finished: dict[str, float] = {}
        self._phase = ""
        self._items = 1
        self._done = 0.0
        self._status = ""
        self._bar = _bar(self._stream) if self._stream.isatty() else None
        self._bar_task = self._bar.add_task("", total=1.0, left="") if self._bar else None

    def __enter__(self) -> Progress:
        self._began_s = self._clock()
        if self._bar:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is None:
            self._close_phase()
            self._show(speak=False)
        if self._bar:
            self._bar.stop()

    def phase(self, name: str, items: int = 1) -> None:
        """Begin the phase ``name`` of ``items`` items, and end the one before."""
        if name not in self._weights:
            raise ValueError(f"phase {name!r} is unknown; known ones are {', '.join(self._weights)}")
        self._close_phase()
        self._phase, self._items, self._done, self._status = name, max(items, 1), 0.0, ""
        self._show(speak=True)

    def advance(self, amount: float = 1.0, status: str = "") -> None:
        """Count ``amount`` more items as done; a whole item gives a line."""
        before = int(self._done + 1e-9)
        self._done = min(self._done + amount, float(self._items))
        self._status = status
        self._show(speak=int(self._done + 1e-9) > before)

    def status(self, text: str) -> None:
        """Show what happens inside the current item."""
        self._status = text
        self._show(speak=False)

    def note(self, text: str) -> None:
        """Print a line that stays."""
        if self._bar:
            self._bar.console.print(text, markup=False, highlight=False)
        else:
            self._write(text)

    @property
    def share(self) -> float:
        """Share of the expected time that is done, 0..1."""
        current = self._weights[self._phase] * self._done / self._items if self._phase else 0.0
        return min((sum(self._finished.values()) + current) / sum(self._weights.values()), 1.0)

    def remaining_s(self) -> float:
        """Return the expected remaining time: at first by the weights, then by the measured speed."""
        if self.share < TRUST_AFTER_SHARE:
            return max(sum(self._weights.values()) - (self._clock() - self._began_s), 0.0)
        return (self._clock() - self._began_s) * (1.0 - self.share) / self.share

    def _close_phase(self) -> None:
        if self._phase:
            self._finished[self._phase] = self._weights[self._phase]
            self._phase = ""

    def _headline(self) -> str:
        if not self._phase:
            return "done"
        count = f" {int(self._done + 1e-9)}/{self._items}" if self._items > 1 else ""
        return f"{self._phase}{count}" + (f": {self._status}" if self._status else "")

    def _show(self, *, speak: bool) -> None:
        """Redraw the bar, or print a line if ``speak`` or the last one is old."""
        left = f"about {duration(self.remaining_s())} left" if self._phase else ""
        if self._bar and self._bar_task is not None:
            self._bar.update(
                self._bar_task, completed=self.share, description=self._headline(), left=left, refresh=speak
            )
            return
        now_s = self._clock()
        if self._phase and (speak or now_s - self._spoke_s >= self._interval_s):
            self._spoke_s = now_s
            self._write(f"[{100 * self.share:3.0f} %] {self._headline()} ({left})")

    def _write(self, line: str) -> None:
        print(line, file=self._stream, flush=True)


def duration(seconds: float) -> str:
    """Format a time span: "40 s", "3 min", "1 h 05 min"."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


def _bar(stream: TextIO) -> RichProgress:
    return RichProgress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[left]}", markup=False),
        console=Console(file=stream),
    )
