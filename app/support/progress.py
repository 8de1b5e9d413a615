"""Progress on stderr: the current phase and item of a command, and the expected time left.

On a terminal a bar that moves within an item, elsewhere plain lines: one at each phase and each finished item, and in
between at most one every few seconds and every percent.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Protocol, TextIO, TypeVar

from rich.console import Console
from rich.progress import BarColumn, TaskProgressColumn, TextColumn
from rich.progress import Progress as RichProgress
from rich.table import Column

PLAIN_INTERVAL_S, PLAIN_SHARE = 5.0, 0.01
REDRAW_S, WAIT_S = 0.1, 0.3
"""Shortest time between two pictures of the bar, and longest one while a future is waited for."""
EXPECTED_SHARE = 0.02
"""Share of the expected time that the expectation counts for beside the measured speed."""
SKIPPED_SHARE = 0.02
"""A phase that took less than this share of its expected time had nothing to do, and says nothing about the speed."""

T = TypeVar("T", covariant=True)


class Waitable(Protocol[T]):
    """A future."""

    def done(self) -> bool:
        """Whether the result is there."""

    def result(self, timeout: float | None = None) -> T:
        """Return the result; TimeoutError where it does not come in time."""


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
        self._began_s = self._phase_s = self._worked_s = self._redrawn_s = clock()
        self._spoke_s = -float("inf")
        self._spoke_share = 0.0
        self._finished: dict[str, float] = {}
        self._skipped = 0.0
        self._phase, self._status = "", ""
        self._items, self._done, self._share, self._found = 1, 0.0, 0.0, 0.0
        # Without a thread of its own: this process is forked.
        self._bar = _bar(self._stream) if self._stream.isatty() else None
        self._bar_task = self._bar.add_task("", total=1.0, left="") if self._bar else None

    def __enter__(self) -> Progress:
        self._began_s = self._worked_s = self._clock()
        if self._bar:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is None:
            self._close_phase()
            self._finished = dict(self._weights)
            self._show(speak=True)
        if self._bar:
            self._bar.stop()

    def phase(self, name: str, items: int = 1) -> None:
        """Begin the phase ``name`` of ``items`` items, and end the one before."""
        if name not in self._weights:
            raise ValueError(f"phase {name!r} is unknown; known ones are {', '.join(self._weights)}")
        self._close_phase()
        self._phase, self._items, self._status = name, max(items, 1), ""
        self._done, self._share, self._found, self._phase_s = 0.0, 0.0, 0.0, self._clock()
        self._show(speak=True)

    def advance(self, amount: float = 1.0, status: str = "", *, share: float | None = None) -> None:
        """Count ``amount`` more items as done; a whole item gives a line.

        ``share``: share of the phase's work that is done where items are not alike, see `within`.
        """
        before = int(self._done + 1e-9)
        self._done = min(self._done + amount, float(self._items))
        self._status = status
        self._work(self._done / self._items if share is None else self._scaled(share))
        self._show(speak=int(self._done + 1e-9) > before)

    def skip(self, amount: float, status: str) -> None:
        """Count ``amount`` items as done that were there before: they say nothing about the speed."""
        self._done += amount
        self._found = self._share = min(self._done / self._items, 1.0)
        self._skipped += self._weights[self._phase] * self._found
        self._status = status
        self._show(speak=True)

    def within(self, share: float, status: str | None = None) -> None:
        """Show that ``share`` (0..1) of the phase's work is done, without what was skipped; items may be half done."""
        self._status = self._status if status is None else status
        self._work(self._scaled(share))
        self._show(speak=False)

    def wait(self, future: Waitable[T]) -> T:
        """Return the result of a future, while the bar moves by the time that one item is expected to take."""
        began_s, base = self._clock(), self._done / self._items
        item_s = self._weights[self._phase] / self._items
        while True:
            try:
                return future.result(timeout=WAIT_S)
            except TimeoutError:
                if future.done():
                    raise
                gone = 1.0 - math.exp((began_s - self._clock()) / item_s)
                self._work(max(self._share, base + gone / self._items))
                self._show(speak=False)

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
        current = self._weights[self._phase] * self._share if self._phase else 0.0
        return min((sum(self._finished.values()) + current) / sum(self._weights.values()), 1.0)

    def remaining_s(self) -> float:
        """Return the expected remaining time: by the weights, and more and more by the measured speed.

        It is estimated when something is done, and counts down in between.
        """
        total, since_s = sum(self._weights.values()), self._clock() - self._worked_s
        expected = EXPECTED_SHARE * total
        slowness = (self._worked_s - self._began_s + expected) / (self.share * total - self._skipped + expected)
        left_s = (1.0 - self.share) * total * slowness
        return max(left_s - since_s, 0.1 * left_s)

    def _scaled(self, share: float) -> float:
        return self._found + (1.0 - self._found) * share

    def _work(self, share: float) -> None:
        if share > self._share:
            self._share, self._worked_s = min(share, 1.0), self._clock()

    def _close_phase(self) -> None:
        if self._phase:
            weight, took_s = self._weights[self._phase], self._clock() - self._phase_s
            if took_s < SKIPPED_SHARE * weight:
                self._skipped += weight * (1.0 - self._found)
            self._finished[self._phase] = weight
            self._phase, self._worked_s = "", self._clock()

    def _headline(self) -> str:
        if not self._phase:
            return "done"
        count = f" {int(self._done + 1e-9)}/{self._items}" if self._items > 1 else ""
        return f"{self._phase}{count}" + (f": {self._status}" if self._status else "")

    def _show(self, *, speak: bool) -> None:
        """Redraw the bar unless that was just done, or print a line if ``speak`` or there is much to add."""
        now_s = self._clock()
        left = f"about {duration(self.remaining_s())} left" if self._phase else f"in {duration(now_s - self._began_s)}"
        if self._bar and self._bar_task is not None:
            if speak or now_s - self._redrawn_s >= REDRAW_S:
                self._redrawn_s = now_s
                self._bar.update(
                    self._bar_task, completed=self.share, description=self._headline(), left=left, refresh=True
                )
            return
        overdue = now_s - self._spoke_s >= self._interval_s and self.share - self._spoke_share >= PLAIN_SHARE
        if speak or overdue:
            self._spoke_s, self._spoke_share = now_s, self.share
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
        TextColumn("{task.description}", markup=False, table_column=Column(no_wrap=True, overflow="ellipsis", ratio=1)),
        BarColumn(bar_width=20),
        TaskProgressColumn(),
        TextColumn("{task.fields[left]}", markup=False, table_column=Column(no_wrap=True)),
        console=Console(file=stream),
        expand=True,
        auto_refresh=False,
    )
