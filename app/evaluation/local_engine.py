"""The engine of one machine: a few groups at a time, each in a fresh process forked from this one.

This process has all modules and has never stepped a simulation: that is what makes its forks alike. It has no other
threads either, and shares nothing with a group but a pipe of its own, so that no process's end can hold up another.
"""

from __future__ import annotations

import contextlib
import os
import signal
import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import cv2

from layflat.app.evaluation.plan import WorkItem
from layflat.app.evaluation.work_item import ALL_RUNS, EpisodeFactory, WorkerMessage, run_file, run_work_item
from layflat.app.workers.interrupts import defer_interrupts
from layflat.app.workers.process import describe_exit_status, die_with_parent

GRACE_S = 20.0
"""A process that has outlived all alarms for that long is stopped, or sleeps where no signal ends it."""
LOOK_S = 0.2
"""How long Ctrl-C may wait for an answer."""

NextWorkItem: TypeAlias = Callable[[], WorkItem | None]
"""The next group to run; None: none for now, though a group that ends may bring more."""


@dataclass(frozen=True)
class WorkResult:
    """How a group ended; runs that are not lost have their file."""

    group: WorkItem
    lost: dict[str, str]
    """Reason by run."""
    rows: dict[str, dict[str, Any]]
    """By run, in so far as somebody could still tell; the file has it all."""
    unwritable: str | None = None
    """Why the folder takes no more files."""


class Engine(Protocol):
    """Runs groups until there are no more. Closing the iterator ends what still runs."""

    def __call__(
        self, next_group: NextWorkItem, folder: Path, play: EpisodeFactory
    ) -> Generator[WorkResult | None, None, None]:
        """Ends as they come, with every run's file in ``folder``; None every now and then, for Ctrl-C."""


class WorkerProcess:
    """A group that runs in a process of its own."""

    def __init__(self, group: WorkItem, folder: Path, play: EpisodeFactory) -> None:
        context = get_context("fork")
        self.group = group
        self._folder = folder
        self._hear, say = context.Pipe(duplex=False)
        self._give_up_s = time.monotonic() + group.limit_s * (len(group.cases) + 2) + GRACE_S
        # daemon: when this program ends by an error of its own, it does not wait for them.
        self._process = context.Process(target=_alone, args=(group, folder, play, say, os.getpid()), daemon=True)
        self._process.start()
        say.close()

    @property
    def sentinel(self) -> int:
        """Ready when the process and its forks have ended."""
        return int(self._process.sentinel)

    @property
    def overdue(self) -> bool:
        return time.monotonic() > self._give_up_s

    def wait(self) -> WorkResult:
        """What came of it, when it has ended; in the end it is ended here."""
        wait([self.sentinel], timeout=max(self._give_up_s - time.monotonic(), 0.0))
        if self.overdue:
            self.kill()
        return self.end()

    def kill(self) -> None:
        """And its forks with it."""
        self._process.kill()
        self._process.join()

    def end(self) -> WorkResult:
        """What came of it, once it has ended."""
        self._process.join()
        said = {item.run: item for item in _all_said(self._hear)}
        rest = said.get(ALL_RUNS) or WorkerMessage(
            ALL_RUNS, describe_exit_status(self._process.exitcode, self.group.limit_s)
        )
        self._hear.close()
        self._process.close()
        missing = [run for run in self.group.run_ids if not run_file(self._folder, run).exists()]
        return WorkResult(
            group=self.group,
            lost={run: said.get(run, rest).reason for run in missing},
            rows={item.run: dict(item.row) for item in said.values() if item.row is not None},
            unwritable=next((item.reason for item in said.values() if item.unwritable), None),
        )


def _all_said(hear: Connection) -> Iterator[WorkerMessage]:
    # A sender that was killed in the middle of a word leaves half of one.
    with contextlib.suppress(EOFError, OSError):
        while hear.poll():
            yield hear.recv()


def _alone(group: WorkItem, folder: Path, play: EpisodeFactory, say: Connection, parent: int) -> None:
    # Ctrl-C reaches the whole process group; only the parent decides what to keep, and then ends the others.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    die_with_parent(parent)
    run_work_item(group, folder, play, say)


def local_engine(workers: int) -> Engine:
    """``workers`` groups at a time."""

    def run(next_group: NextWorkItem, folder: Path, play: EpisodeFactory) -> Generator[WorkResult | None, None, None]:
        # Here, where OpenCV's threads are: a fork that has not got them waits for ever when it is to end them.
        cv2.setNumThreads(1)
        running: list[WorkerProcess] = []
        try:
            while True:
                while len(running) < workers and (group := next_group()) is not None:
                    with defer_interrupts():
                        running.append(WorkerProcess(group, folder, play))
                if not running:
                    return
                ready = wait([item.sentinel for item in running], timeout=LOOK_S)
                yield None
                for item in [item for item in running if item.sentinel in ready or item.overdue]:
                    if item.overdue:
                        item.kill()
                    running.remove(item)
                    yield item.end()
        finally:
            for item in running:
                item.kill()

    return run
