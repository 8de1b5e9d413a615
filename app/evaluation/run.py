"""Runs a plan into a folder, from where an earlier run stopped."""

from __future__ import annotations

import shutil
import signal
import threading
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from layflat.app.evaluation import config_file
from layflat.app.evaluation.local_engine import Engine, WorkResult, local_engine
from layflat.app.evaluation.plan import EvaluationPlan, WorkItem
from layflat.app.evaluation.results import (
    BATCH,
    EPISODES,
    RUNS,
    SUMMARY,
    EvaluationResults,
    as_rows,
    read_rows,
    read_run,
)
from layflat.app.evaluation.results_csv import ResultsCsv
from layflat.app.evaluation.simulated_episode import SimulatedEpisode
from layflat.app.evaluation.summary import summary_of
from layflat.app.evaluation.work_item import EpisodeFactory, run_file
from layflat.app.support import validators
from layflat.app.support.errors import LayflatError, UsageError
from layflat.app.support.metrics import crashed_metrics, episode_metrics, write_json
from layflat.app.support.progress import Progress
from layflat.app.support.provenance import capture_provenance, git_revision
from layflat.data.atomic_files import PART_SUFFIX, WriterLock, os_reason
from layflat.data.errors import DataError

ATTEMPTS = 2
"""A crash may have been the machine's: what is lost is tried once more."""
LOCK = ".running"


def run_batch(
    plan: EvaluationPlan,
    out: Path,
    *,
    workers: int = 1,
    engine: Engine | None = None,
    force: bool = False,
    progress: Progress | None = None,
    play: EpisodeFactory = SimulatedEpisode,
) -> EvaluationResults:
    """Run what ``out`` does not hold yet of ``plan``; episodes that crash are rows, not errors.

    ``engine`` is this machine's unless another is given. ``progress`` is in a phase whose items are the plan's
    episodes. KeyboardInterrupt comes when everything that is finished has been kept. UsageError where ``out`` holds
    another batch; LayflatError where it takes no more files.
    """
    validators.writable_folder(out)
    with WriterLock(out / LOCK, out), _disk(out):
        if force:
            clear(out)
        batch = Batch(plan, out, progress)
        try:
            with _interrupts() as interrupts:
                batch.run(engine or local_engine(workers), play, interrupts)
        finally:
            batch.finish()
    return EvaluationResults.open(out)


def clear(out: Path) -> None:
    """Remove what an earlier batch wrote there, and nothing else."""
    for name in (BATCH, EPISODES, SUMMARY, "report.html"):
        (out / name).unlink(missing_ok=True)
    shutil.rmtree(out / RUNS, ignore_errors=True)


class Batch:
    """A plan and the folder that it runs into."""

    def __init__(self, plan: EvaluationPlan, out: Path, progress: Progress | None) -> None:
        self._plan = plan
        self._out = out
        self._progress = progress
        self._runs = out / RUNS
        if (out / EPISODES).exists() and not (out / BATCH).exists():
            raise UsageError(f"{out} holds other results; choose another --out, or --force to replace them")
        self._asked = config_file.merge_config(plan, out / BATCH)
        self._runs.mkdir(exist_ok=True)
        for torn in self._runs.glob(f"*{PART_SUFFIX}"):
            torn.unlink()
        config_file.save_config(out / BATCH, self._asked)
        self._ledger = ResultsCsv(out / EPISODES)
        self._again: deque[WorkItem] = deque()
        self._groups = plan.groups()

    def run(self, engine: Engine, play: EpisodeFactory, interrupts: Interrupts) -> None:
        """Until nothing is left; KeyboardInterrupt after Ctrl-C."""
        self._collect()
        self._count_finished()
        with closing(engine(self._next, self._runs, play)) as ends:
            for end in ends:
                if interrupts.came:
                    raise KeyboardInterrupt
                if end is not None:
                    self._note(end)

    def finish(self) -> None:
        """Rows in their order and the summary, of whatever there is; what has no room is made by the next run."""
        with suppress(OSError):
            self._collect()
            self._ledger.sort(config_file.order(self._asked))
            rows = read_rows(self._out / EPISODES)
            if len(rows):
                provenance = {
                    **vars(capture_provenance()),
                    "git": git_revision(),
                    "seeds": self._asked["seeds"],
                    "asked": BATCH,
                }
                content = {**summary_of(rows), "episodes": as_rows(rows), "provenance": provenance}
                write_json(self._out / SUMMARY, content)

    def _next(self) -> WorkItem | None:
        if self._again:
            return self._again.popleft()
        for group in self._groups:
            missing = set(group.run_ids) - self._ledger.runs
            if missing:
                return group.only(missing)
        return None

    def _note(self, end: WorkResult) -> None:
        """Rows of what is finished, another try of what is lost, and then a row for that, too."""
        rows, lost = [], dict(end.lost)
        for run in end.group.run_ids:
            if run not in lost:
                try:
                    rows.append(self._row(run, end.group.attempt, end.rows.get(run)))
                except DataError as error:
                    run_file(self._runs, run).unlink()
                    lost[run] = str(error)
        if end.unwritable is None and lost:
            if end.group.attempt < ATTEMPTS:
                self._again.append(end.group.only(lost, attempt=end.group.attempt + 1))
            else:
                rows += [_crashed_row(end.group, run, reason) for run, reason in lost.items()]
        self._ledger.add(rows)
        self._tell(rows)
        if end.unwritable is not None:
            raise LayflatError(_full(self._out, end.unwritable))

    def _row(self, run: str, attempt: int, known: Mapping[str, Any] | None = None) -> dict[str, Any]:
        row = known or episode_metrics(read_run(self._runs, run))
        return {**row, "run": run, "start": self._plan.start, "attempts": attempt, "reason": None}

    def _collect(self) -> None:
        """Rows of the episodes that were finished when somebody ended the batch."""
        for path in sorted(self._runs.glob("*.h5")):
            if path.stem not in self._ledger.runs:
                try:
                    self._ledger.add([self._row(path.stem, 1)])
                except DataError:
                    path.unlink()

    def _count_finished(self) -> None:
        if self._progress is not None:
            planned = (run for group in self._plan.groups() for run in group.run_ids)
            finished = sum(run in self._ledger.runs for run in planned)
            if finished:
                self._progress.advance(finished, status="already there")

    def _tell(self, rows: list[dict[str, Any]]) -> None:
        if self._progress is None:
            return
        for row in rows:
            moments = [row["contact_placed"], row["contact_disturbed"], row["contact_final"]]
            contact = " -> ".join("-" if c is None else f"{c:.2f}" for c in moments)
            what = f"crashed, {row['reason']}" if row["crashed"] else f"contact {contact}"
            self._progress.advance(status=f"{row['run']}: {what}")


def _crashed_row(group: WorkItem, run: str, reason: str) -> dict[str, Any]:
    case = next(case for case in group.cases if group.run_id(case) == run)
    row = crashed_metrics(
        policy=group.entrant.name,
        robot=group.entrant.robot,
        cloth=group.cloth,
        seed=group.seed,
        disturbance=case.name,
        reason=reason,
    )
    return row | {"run": run, "start": group.start, "attempts": group.attempt}


@dataclass
class Interrupts:
    """Whether Ctrl-C has come; what is being kept at that moment is kept."""

    came: bool = False


@contextmanager
def _interrupts() -> Iterator[Interrupts]:
    interrupts = Interrupts()
    if threading.current_thread() is not threading.main_thread():
        yield interrupts  # Ctrl-C never comes here.
        return

    def note(number: int, frame: object) -> None:
        interrupts.came = True

    before = signal.signal(signal.SIGINT, note)
    try:
        yield interrupts
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def _disk(out: Path) -> Iterator[None]:
    """What the folder does not take, as a sentence."""
    try:
        yield
    except OSError as error:
        raise LayflatError(_full(out, os_reason(error))) from error


def _full(out: Path, reason: str) -> str:
    return f"{out} takes no more files: {reason}; what is finished is kept, and the same command goes on from there"
