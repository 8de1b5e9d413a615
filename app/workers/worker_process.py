"""The parent's side of work items: a few at a time, each in a fresh process forked from this one.

The simulation is only reproducible in a process that has never stepped one: this process has all modules loaded and
never steps. It starts no threads either, and shares nothing with a worker but a pipe, so that the end of one process
cannot block another.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Protocol, TypeAlias

import cv2

from layflat.app.workers.episode_worker import ALL_RUNS, WorkerMessage, run_work_item
from layflat.app.workers.interrupts import defer_interrupts
from layflat.app.workers.item_progress import RunningItem
from layflat.app.workers.process import configure_child, describe_exit_status
from layflat.app.workers.simulated_episode import EpisodeFactory
from layflat.app.workers.step_counter import StepCounter
from layflat.app.workers.work_item import WorkItem, WorkResult, run_file

GRACE_S = 20.0
"""Time by which a process may outlive its deadlines: longer, and it is stopped or sleeps where no alarm ends it."""
POLL_S = 0.2
"""Longest time until Ctrl-C is noticed."""

NextWorkItem: TypeAlias = Callable[[], WorkItem | None]
"""Returns the next item to run; None: none for now, though an item that ends may bring more."""


class Engine(Protocol):
    """Runs work items until there are no more. Closing the iterator ends those that still run."""

    def __call__(
        self, next_item: NextWorkItem, folder: Path, make: EpisodeFactory
    ) -> Generator[WorkResult | Sequence[RunningItem], None, None]:
        """Yield results as they come, with every run's file in ``folder``; every now and then what runs, for Ctrl-C."""


class WorkerProcess:
    """A work item that runs in a process of its own."""

    def __init__(self, item: WorkItem, folder: Path, make: EpisodeFactory) -> None:
        context = get_context("fork")
        self.item = item
        self._folder = folder
        self._connection, theirs = context.Pipe(duplex=False)
        self._counter = StepCounter()
        self._give_up_s = time.monotonic() + item.limit_s * (len(item.cases) + 2) + GRACE_S
        # daemon: when this program ends by an error of its own, it does not wait for them.
        args = (item, folder, make, theirs, self._counter, os.getpid())
        self._process = context.Process(target=_run_alone, args=args, daemon=True)
        self._process.start()
        theirs.close()

    @property
    def sentinel(self) -> int:
        """Handle that is ready when the process and its forks have ended."""
        return int(self._process.sentinel)

    @property
    def steps(self) -> int:
        """Number of steps so far, of all cases."""
        return self._counter.steps

    @property
    def overdue(self) -> bool:
        """Whether the process has outlived all its deadlines."""
        return time.monotonic() > self._give_up_s

    def wait(self) -> WorkResult:
        """Wait until the process has ended, at most for its deadlines, and return the result."""
        wait([self.sentinel], timeout=max(self._give_up_s - time.monotonic(), 0.0))
        if self.overdue:
            self.kill()
        return self.result()

    def kill(self) -> None:
        """End the process, and its forks with it."""
        self._process.kill()
        self._process.join()

    def result(self) -> WorkResult:
        """Return the result of the item, once its process has ended."""
        self._process.join()
        item = self.item
        messages = {message.run: message for message in _received(self._connection)}
        rest = messages.get(ALL_RUNS) or WorkerMessage(
            ALL_RUNS, describe_exit_status(self._process.exitcode, item.limit_s)
        )
        self._connection.close()
        self._process.close()
        saved = next((message.saved for message in messages.values() if message.saved is not None), None)
        missing = [run for run in item.run_ids if not run_file(self._folder, run).exists()]
        if item.handle is not None:
            missing = list(item.run_ids) if saved is None else []
        return WorkResult(
            item=item,
            lost={run: messages.get(run, rest).reason for run in missing},
            rows={message.run: dict(message.row) for message in messages.values() if message.row is not None},
            saved=saved,
            unwritable=next((message.reason for message in messages.values() if message.unwritable), None),
        )


def _received(connection: Connection) -> Iterator[WorkerMessage]:
    # A sender that was killed in the middle of a message leaves half of one.
    with contextlib.suppress(EOFError, OSError):
        while connection.poll():
            yield connection.recv()


def _run_alone(
    item: WorkItem, folder: Path, make: EpisodeFactory, connection: Connection, counter: StepCounter, parent: int
) -> None:
    configure_child(parent)
    run_work_item(item, folder, make, connection, counter)


def local_engine(workers: int) -> Engine:
    """Return the engine that runs ``workers`` items at a time on this machine."""

    def run(
        next_item: NextWorkItem, folder: Path, make: EpisodeFactory
    ) -> Generator[WorkResult | Sequence[RunningItem], None, None]:
        # Here, where OpenCV's threads are: a fork, which lacks them, would wait forever for them to end.
        cv2.setNumThreads(1)
        running: list[WorkerProcess] = []
        try:
            while True:
                while len(running) < workers and (item := next_item()) is not None:
                    with defer_interrupts():
                        running.append(WorkerProcess(item, folder, make))
                if not running:
                    return
                ready = wait([worker.sentinel for worker in running], timeout=POLL_S)
                yield [RunningItem(worker.item, worker.steps) for worker in running]
                for worker in [worker for worker in running if worker.sentinel in ready or worker.overdue]:
                    if worker.overdue:
                        worker.kill()
                    running.remove(worker)
                    yield worker.result()
        finally:
            for worker in running:
                worker.kill()

    return run
