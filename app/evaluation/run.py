"""run_evaluation: run a plan into a folder, from where an earlier run stopped."""

from __future__ import annotations

import shutil
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

from layflat.app.evaluation import config_file
from layflat.app.evaluation.plan import EvaluationPlan
from layflat.app.evaluation.results import (
    CONFIG,
    EPISODES,
    RUNS,
    SUMMARY,
    EvaluationResults,
    as_rows,
    read_rows,
)
from layflat.app.evaluation.results_csv import ResultsCsv
from layflat.app.evaluation.summary import summary_of
from layflat.app.support import validators
from layflat.app.support.errors import LayflatError, UsageError
from layflat.app.support.metrics import crashed_metrics, episode_metrics, write_json
from layflat.app.support.progress import Progress
from layflat.app.workers.interrupts import note_interrupts
from layflat.app.workers.item_progress import ItemProgress
from layflat.app.workers.simulated_episode import EpisodeFactory, SimulatedEpisode
from layflat.app.workers.work_item import WorkItem, WorkResult, read_run, run_file
from layflat.app.workers.worker_process import Engine, local_engine
from layflat.data.atomic_files import PART_SUFFIX, WriterLock
from layflat.data.errors import DataError
from layflat.data.provenance import capture_provenance, git_revision
from layflat.data.system_errors import os_reason

ATTEMPTS = 2
"""A crash may be the machine's fault: what is lost is tried once more."""
LOCK = ".running"


def run_evaluation(
    plan: EvaluationPlan,
    out: Path,
    *,
    workers: int = 1,
    engine: Engine | None = None,
    force: bool = False,
    progress: Progress | None = None,
    make: EpisodeFactory = SimulatedEpisode,
    locked: bool = False,
) -> EvaluationResults:
    """Run the part of a plan that ``out`` does not contain yet; episodes that crash are rows, not errors.

    ``engine`` is this machine's by default. ``progress`` is in a phase whose items are the plan's episodes.
    ``locked``: the caller has the `folder_lock`.
    KeyboardInterrupt is raised after everything that is finished has been saved. UsageError where ``out`` contains
    another evaluation; LayflatError where it takes no more files.
    """
    with nullcontext() if locked else folder_lock(out), _disk(out):
        if force:
            clear(out)
        evaluation = Evaluation(plan, out, progress)
        try:
            evaluation.run(engine or local_engine(workers), make)
        finally:
            evaluation.finish()
    return EvaluationResults.open(out)


@contextmanager
def folder_lock(out: Path) -> Iterator[None]:
    """Make ``out`` and keep it for this process; DataError where another one works there."""
    validators.writable_folder(out)
    with WriterLock(out / LOCK, out):
        yield


def clear(out: Path) -> None:
    """Remove what an earlier evaluation wrote there, and nothing else."""
    for name in (CONFIG, EPISODES, SUMMARY, "report.html"):
        (out / name).unlink(missing_ok=True)
    shutil.rmtree(out / RUNS, ignore_errors=True)


class Evaluation:
    """A plan and the folder that it runs into."""

    def __init__(self, plan: EvaluationPlan, out: Path, progress: Progress | None) -> None:
        self._plan = plan
        self._out = out
        self._progress = progress
        self._episodes: ItemProgress | None = None
        self._runs = out / RUNS
        if (out / EPISODES).exists() and not (out / CONFIG).exists():
            raise UsageError(f"{out} contains other results; choose another --out, or --force to replace them")
        self._config = config_file.merge_config(plan, out / CONFIG)
        self._runs.mkdir(exist_ok=True)
        for torn in self._runs.glob(f"*{PART_SUFFIX}"):
            torn.unlink()
        config_file.save_config(out / CONFIG, self._config)
        self._csv = ResultsCsv(out / EPISODES)
        self._retries: deque[WorkItem] = deque()
        self._items = plan.items()

    def run(self, engine: Engine, make: EpisodeFactory) -> None:
        """Run until nothing is left; KeyboardInterrupt after Ctrl-C."""
        self._collect()
        self._count_finished()
        with note_interrupts() as interrupts, closing(engine(self._next, self._runs, make)) as results:
            for result in results:
                if interrupts.received:
                    raise KeyboardInterrupt
                if isinstance(result, WorkResult):
                    self._add(result)
                elif self._episodes is not None:
                    self._episodes.show_running(result)

    def finish(self) -> None:
        """Write the rows in their order and the summary; what has no room on the disk is made by the next run."""
        with suppress(OSError):
            self._collect()
            self._csv.sort(config_file.sort_key(self._config))
            rows = read_rows(self._out / EPISODES)
            if len(rows):
                provenance = {
                    **vars(capture_provenance()),
                    "git": git_revision(),
                    "seeds": self._config["seeds"],
                    "config": CONFIG,
                }
                results = {**summary_of(rows), "taught": self._config["taught"], "episodes": as_rows(rows)}
                write_json(self._out / SUMMARY, {**results, "provenance": provenance})

    def _next(self) -> WorkItem | None:
        if self._retries:
            return self._retries.popleft()
        for item in self._items:
            missing = set(item.run_ids) - self._csv.runs
            if missing:
                return item.subset(missing)
        return None

    def _add(self, result: WorkResult) -> None:
        """Add rows of finished episodes; try what is lost once more, and then add a row for that too."""
        rows, lost, item = [], dict(result.lost), result.item
        for run in item.run_ids:
            if run not in lost:
                try:
                    rows.append(self._row(run, item.attempt, result.rows.get(run)))
                except DataError as error:
                    run_file(self._runs, run).unlink()
                    lost[run] = str(error)
        if result.unwritable is None and lost:
            if item.attempt < ATTEMPTS:
                self._retries.append(item.subset(lost, attempt=item.attempt + 1))
            else:
                rows += [_crashed_row(item, run, reason) for run, reason in lost.items()]
        self._csv.add(rows)
        self._report(rows)
        if result.unwritable is not None:
            raise LayflatError(_full(self._out, result.unwritable))

    def _row(self, run: str, attempt: int, known: Mapping[str, Any] | None = None) -> dict[str, Any]:
        row = known or episode_metrics(read_run(self._runs, run))
        return {**row, "run": run, "start": self._plan.start, "attempts": attempt, "reason": None}

    def _collect(self) -> None:
        """Add rows of the episodes that were finished when an earlier run was killed."""
        for path in sorted(self._runs.glob("*.h5")):
            if path.stem not in self._csv.runs:
                try:
                    self._csv.add([self._row(path.stem, 1)])
                except DataError:
                    path.unlink()

    def _count_finished(self) -> None:
        if self._progress is not None:
            planned = (run for item in self._plan.items() for run in item.run_ids)
            finished = sum(run in self._csv.runs for run in planned)
            if finished:
                self._progress.skip(finished, "already there")
            self._episodes = ItemProgress(self._progress, self._plan.n_episodes - finished)

    def _report(self, rows: list[dict[str, Any]]) -> None:
        if self._episodes is None:
            return
        for row in rows:
            portions = [row["contact_placed"], row["contact_disturbed"], row["contact_final"]]
            contact = " -> ".join("-" if c is None else f"{c:.2f}" for c in portions)
            what = f"crashed, {row['reason']}" if row["crashed"] else f"contact {contact}"
            self._episodes.finish(1, f"{what}, {row['run']}")


def _crashed_row(item: WorkItem, run: str, reason: str) -> dict[str, Any]:
    case = next(case for case in item.cases if item.run_id(case) == run)
    row = crashed_metrics(item.policy.label, item.config, item.seed, case.name, reason)
    return row | {"run": run, "start": item.config.start, "attempts": item.attempt}


@contextmanager
def _disk(out: Path) -> Iterator[None]:
    """Raise errors of the file system as LayflatError, in one sentence."""
    try:
        yield
    except OSError as error:
        raise LayflatError(_full(out, os_reason(error))) from error


def _full(out: Path, reason: str) -> str:
    return f"{out} takes no more files: {reason}; what is finished is kept, and the same command continues from there"
