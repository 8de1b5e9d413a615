"""What runs in a fresh process: one placing, and a fork of the process at that moment for each case.

Forking copies the whole simulation, velocities and all, so that twins are exact: they differ in nothing but the
disturbance. Each fork writes its own episode as a session of its own, durable, before it ends: that the file is there
is what counts as finished, whatever happens to any process afterwards.
"""

from __future__ import annotations

import uuid
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Protocol, TypeAlias

from layflat.app.evaluation.plan import DisturbanceCase, WorkItem
from layflat.app.support.errors import format_error
from layflat.app.support.metrics import episode_metrics
from layflat.app.workers.process import describe_exit_status, run_in_fork, set_deadline
from layflat.data.atomic_files import fsync_write, os_reason
from layflat.data.session.session_writer import serialize
from layflat.data.types import Episode

DEMO = "demo_0"
REASON_CHARS = 300
"""All that is said of a group's losses has to fit into a pipe."""
ALL_RUNS = ""
UNWRITABLE_STATUS = 2
"""Of a fork whose episode could not be written."""


class ForkableEpisode(Protocol):
    """A group's episode in the making."""

    def run_until_stop(self) -> None:
        """Until the policy stops."""

    def finish(self, case: DisturbanceCase) -> Episode:
        """What follows; and the placing first, where it has not been done yet."""


EpisodeFactory: TypeAlias = Callable[[WorkItem], ForkableEpisode]
"""Begins a group's episode: the bench is reset, no step has passed."""


@dataclass(frozen=True)
class WorkerMessage:
    """What a group's process tells of a run."""

    run: str
    """ALL_RUNS: of every run that is not told of by itself."""
    reason: str = ""
    """Why there is no file."""
    unwritable: bool = False
    """The folder takes no more files, which is not the episode's fault."""
    row: Mapping[str, Any] | None = None
    """Of an episode whose file is durable; it could be made from the file, too, which takes longer."""


def run_file(folder: Path, run: str) -> Path:
    return folder / f"{run}.h5"


def run_work_item(group: WorkItem, folder: Path, play: EpisodeFactory, say: Connection) -> None:
    """Run the group's cases in forks of this process, which is used up then; what is lost is said, never raised."""
    early = [case for case in group.cases if not case.after_the_stop]
    late = [case for case in group.cases if case.after_the_stop]
    try:
        set_deadline(group.limit_s)
        playing = play(group)
        if _finish_all(group, early, playing, folder, say) and late:
            set_deadline(group.limit_s)
            playing.run_until_stop()
            _finish_all(group, late, playing, folder, say)
    except Exception as error:
        say.send(WorkerMessage(ALL_RUNS, _words(error)))


def _finish_all(
    group: WorkItem, cases: Sequence[DisturbanceCase], playing: ForkableEpisode, folder: Path, say: Connection
) -> bool:
    """Each case in a copy of this process; False where the folder takes no more files."""
    set_deadline(0)
    for case in cases:
        status = run_in_fork(partial(_finish, group, case, playing, folder, say))
        if status == UNWRITABLE_STATUS:
            return False
        if status != 0:
            say.send(WorkerMessage(group.run_id(case), describe_exit_status(status, group.limit_s)))
    return True


def _finish(group: WorkItem, case: DisturbanceCase, playing: ForkableEpisode, folder: Path, say: Connection) -> int:
    run = group.run_id(case)
    set_deadline(group.limit_s)
    try:
        episode = replace(playing.finish(case), source=group.entrant.name, disturbance=case.name)
        image = serialize(DEMO, episode, uuid.uuid4().hex, keep_images=True)
    except Exception as error:
        say.send(WorkerMessage(run, _words(error)))
        return 0
    try:
        fsync_write(run_file(folder, run), image)
    except OSError as error:
        say.send(WorkerMessage(run, os_reason(error), unwritable=True))
        return UNWRITABLE_STATUS
    say.send(WorkerMessage(run, row=episode_metrics(episode)))
    return 0


def _words(error: Exception) -> str:
    return format_error(error)[0][:REASON_CHARS]
