"""ItemProgress: how much of the work of several items is done, by the steps of those that run."""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from layflat.app.support.progress import Progress
from layflat.app.workers.work_item import WorkItem

PLACING_STEPS, CASE_STEPS = 80, 40
"""Expected steps of a placement and of what follows in each case, until the first ones have ended."""
RESET_STEPS = 10
"""Steps that take as long as the start of an item."""
NEAR = 0.9
"""Share of the expected steps from which an item counts for less a step, since its end is not known."""
MANY = 1000
"""Number of waiting episodes from which their order does not matter for the time that they take."""


@dataclass(frozen=True)
class RunningItem:
    """An item that a worker runs now."""

    item: WorkItem
    steps: int
    """Steps so far, of all its cases."""


class ItemProgress:
    """Share of the work in a phase whose items are episodes, several of which run at a time and some in one item."""

    def __init__(self, progress: Progress, episodes: int) -> None:
        """``progress`` is in the phase; ``episodes`` are those that have not been skipped."""
        self._progress = progress
        self._episodes = episodes
        self._ended = self._workers = 0
        self._work = self._time = 0.0
        self._running: Sequence[RunningItem] = ()
        self._known: defaultdict[tuple[str, str], list[float]] = defaultdict(list)

    def show_running(self, running: Sequence[RunningItem]) -> None:
        """Show how far the running items are."""
        ended = [run for run in self._running if all(run.item is not now.item for now in running)]
        for run in ended:
            self._ended = min(self._ended + len(run.item.cases), self._episodes)
            if run.steps:
                self._known[_kind(run.item)].append(run.steps / self._expected(run.item))
        busy = max(len(running), len(self._running), 1)
        self._running, self._workers = running, max(self._workers, len(running))
        self._add_work(busy)
        self._progress.within(self.share)

    def finish(self, episodes: int, status: str) -> None:
        """Count episodes as finished; how far the work is, `show_running` says where the engine knows it."""
        self._progress.advance(episodes, status, share=self.share if self._workers else None)

    @property
    def share(self) -> float:
        """Share of the whole time that is over, 0..1, where ``workers`` items run at a time until none is left."""
        begun = self._begun()
        left = [size * (1.0 - fraction) for size, fraction in begun]
        size = max((size for size, _ in begun), default=1)
        waiting = max(self._episodes - self._ended - sum(size for size, _ in begun), 0)
        ahead = _makespan(left, waiting, size, self._workers)
        return self._time / (self._time + ahead) if self._time + ahead > 0 else 1.0

    def _begun(self) -> list[tuple[int, float]]:
        """Return the size of each running item, and the fraction of it that is done."""
        return [(len(run.item.cases), self._fraction(run)) for run in self._running]

    def _add_work(self, busy: int) -> None:
        """Add the time, in episodes of one worker, that ``busy`` workers took for what is done since the last call."""
        work = self._ended + sum(size * fraction for size, fraction in self._begun())
        self._time = max(self._time + (work - self._work) / busy, 0.0)
        self._work = work

    def _fraction(self, run: RunningItem) -> float:
        if not run.steps:
            return 0.0
        done = (run.steps + RESET_STEPS) / (self._expected(run.item) * self._scale(run.item) + RESET_STEPS)
        return done if done < NEAR else 1.0 - (1.0 - NEAR) * NEAR / done

    def _expected(self, item: WorkItem) -> float:
        return float(PLACING_STEPS + CASE_STEPS * (len(item.cases) - 1))

    def _scale(self, item: WorkItem) -> float:
        """Return steps over expected steps of the finished items, of the same kind if there are any."""
        known = self._known[_kind(item)] or [ratio for ratios in self._known.values() for ratio in ratios]
        return sum(known) / len(known) if known else 1.0


def _kind(item: WorkItem) -> tuple[str, str]:
    return item.policy.label, item.config.robot


def _makespan(left: Sequence[float], waiting: int, size: int, workers: int) -> float:
    """Return the time until everything is done: the ``left`` parts, then ``waiting`` in pieces of ``size``."""
    if waiting > MANY:
        return (sum(left) + waiting) / workers
    free = sorted([*left, *[0.0] * (workers - len(left))])
    while waiting > 0:
        piece = min(waiting, size)
        heapq.heappush(free, heapq.heappop(free) + piece)
        waiting -= piece
    return max(free, default=0.0)
