"""The child's side of a work item: run the placement once, and a fork of the process for each case.

Forking copies the whole simulation, velocities and all, so that undisturbed pairs are exact: they differ in nothing
but the disturbance. Each fork writes its own episode as a session of its own, durable, before it ends: an episode is
finished when its file is there, also if every process is killed afterwards.
"""

from __future__ import annotations

import uuid
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from layflat.app.support.errors import format_error
from layflat.app.support.metrics import episode_metrics
from layflat.app.workers.process import describe_exit_status, run_in_fork, set_deadline
from layflat.app.workers.simulated_episode import EpisodeFactory, ForkableEpisode
from layflat.app.workers.step_counter import CountedCallback, StepCounter
from layflat.app.workers.work_item import DisturbanceCase, WorkItem, run_file
from layflat.data.atomic_files import fsync_write
from layflat.data.errors import WriteError
from layflat.data.session.journal import JournalHandle
from layflat.data.session.saved_episode import SavedEpisode
from layflat.data.session.session_writer import serialize
from layflat.data.system_errors import os_reason
from layflat.data.types import Episode

DEMO = "demo_0"
REASON_CHARS = 300
"""All messages of a work item have to fit into a pipe."""
ALL_RUNS = ""
UNWRITABLE_STATUS = 2
"""Exit status of a fork whose episode could not be written."""


@dataclass(frozen=True)
class WorkerMessage:
    """A message of a worker about one run."""

    run: str
    """ALL_RUNS: every run that has no message of its own."""
    reason: str = ""
    """Why there is no file."""
    unwritable: bool = False
    """The folder takes no more files, which is not the episode's fault."""
    row: Mapping[str, Any] | None = None
    """Metrics of an episode whose file is durable; computing them from the file takes longer."""
    saved: SavedEpisode | None = None
    """Report of the recorded episode."""


def run_work_item(
    item: WorkItem, folder: Path, make: EpisodeFactory, connection: Connection, counter: StepCounter
) -> None:
    """Run the cases of a work item. Errors are sent to the parent, not raised; the process must not be reused."""
    try:
        set_deadline(item.limit_s * (1 if item.handle is None else 2))
        if item.handle is not None:
            connection.send(_record(item, item.handle, folder, make, counter))
            return
        early = [case for case in item.cases if not case.is_post_stop]
        late = [case for case in item.cases if case.is_post_stop]
        episode = make(item, lambda beginning: counter)
        if _run_all(item, early, episode, folder, connection) and late:
            set_deadline(item.limit_s)
            episode.run_until_stop()
            _run_all(item, late, episode, folder, connection)
    except Exception as error:
        connection.send(WorkerMessage(ALL_RUNS, _reason(error), unwritable=isinstance(error, WriteError)))


def _record(
    item: WorkItem, handle: JournalHandle, folder: Path, make: EpisodeFactory, counter: StepCounter
) -> WorkerMessage:
    """Run the only case beside a journal, which is removed when the episode's part of the session is durable."""
    (case,) = item.cases
    with ExitStack() as stack:

        def start(beginning: Episode) -> CountedCallback:
            return CountedCallback(stack.enter_context(closing(handle.open(beginning))), counter)

        episode = _named(item, case, make(item, start).run_case(case))
    if item.keep_images and not handle.save_images:
        fsync_write(run_file(folder, item.run_id(case)), serialize(DEMO, episode, handle.uid, save_images=True))
    return WorkerMessage(item.run_id(case), row=episode_metrics(episode), saved=handle.save(episode))


def _run_all(
    item: WorkItem, cases: Sequence[DisturbanceCase], episode: ForkableEpisode, folder: Path, connection: Connection
) -> bool:
    """Run each case in a copy of this process; return False where the folder takes no more files."""
    set_deadline(0)
    for case in cases:
        status = run_in_fork(partial(_run_case, item, case, episode, folder, connection))
        if status == UNWRITABLE_STATUS:
            return False
        if status != 0:
            connection.send(WorkerMessage(item.run_id(case), describe_exit_status(status, item.limit_s)))
    return True


def _run_case(
    item: WorkItem, case: DisturbanceCase, running: ForkableEpisode, folder: Path, connection: Connection
) -> int:
    run = item.run_id(case)
    set_deadline(item.limit_s)
    try:
        episode = _named(item, case, running.run_case(case))
        image = serialize(DEMO, episode, uuid.uuid4().hex, save_images=True)
    except Exception as error:
        connection.send(WorkerMessage(run, _reason(error)))
        return 0
    try:
        fsync_write(run_file(folder, run), image)
    except OSError as error:
        connection.send(WorkerMessage(run, os_reason(error), unwritable=True))
        return UNWRITABLE_STATUS
    connection.send(WorkerMessage(run, row=episode_metrics(episode)))
    return 0


def _named(item: WorkItem, case: DisturbanceCase, episode: Episode) -> Episode:
    return replace(episode, source=item.policy.label, disturbance=case.name)


def _reason(error: Exception) -> str:
    return format_error(error)[0][:REASON_CHARS]
