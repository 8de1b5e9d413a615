"""Run work items on this machine, with their results in order; and record episodes into a session."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from layflat.app.support.errors import LayflatError
from layflat.app.support.metrics import crashed_metrics
from layflat.app.support.progress import Progress
from layflat.app.support.session_lines import kept_line
from layflat.app.workers.interrupts import note_interrupts
from layflat.app.workers.simulated_episode import EpisodeFactory, SimulatedEpisode
from layflat.app.workers.work_item import WorkItem, WorkResult, read_run, run_file
from layflat.app.workers.worker_process import local_engine
from layflat.data.session.journal import JournalHandle
from layflat.data.session.recorder import SessionRecorder
from layflat.data.session.saved_episode import SavedEpisode
from layflat.data.types import Episode
from layflat.policy.spec import SCRIPTED, PolicySpec
from layflat.sim.config import SimConfig


def run_items(
    items: Sequence[WorkItem], folder: Path, *, workers: int, make: EpisodeFactory = SimulatedEpisode
) -> Generator[WorkResult, None, None]:
    """Yield the results in the order of ``items``, each as soon as it and those before it are there.

    Ctrl-C becomes a KeyboardInterrupt only when the caller has dealt with the result at hand, and with those that are
    finished besides. Closing the iterator ends the workers.
    """
    waiting, finished, position = iter(items), dict[int, WorkResult](), 0
    place = {id(item): k for k, item in enumerate(items)}
    engine = local_engine(workers)
    with note_interrupts() as interrupts, closing(engine(lambda: next(waiting, None), folder, make)) as results:
        for result in results:
            if result is not None:
                finished[place[id(result.item)]] = result
            while position in finished:
                yield finished.pop(position)
                position += 1
            if interrupts.received:
                break
        yield from (finished[k] for k in sorted(finished))
        if interrupts.received:
            raise KeyboardInterrupt


def record_items(
    items: Sequence[WorkItem],
    recorder: SessionRecorder,
    folder: Path | None = None,
    *,
    workers: int,
    make: EpisodeFactory = SimulatedEpisode,
) -> Generator[tuple[WorkResult, SavedEpisode | None], None, None]:
    """Run items of one case each into a session; yield each result with where it is saved, durable by then.

    Images that an item keeps and the session does not are in the episode's file in ``folder``.
    Every episode has a journal while it runs. What there is of an episode that was lost is saved as partial (None:
    there is nothing). After Ctrl-C the episodes that were still running are discarded.
    """
    recorded = [replace(item, handle=recorder.new_journal()) for item in items]
    open_handles = {handle.uid: handle for handle in map(_handle, recorded)}
    try:
        with closing(run_items(recorded, folder or recorder.path.parent, workers=workers, make=make)) as results:
            for result in results:
                handle = open_handles.pop(_handle(result.item).uid)
                if result.saved is None:
                    yield result, recorder.recover(handle)
                else:
                    recorder.register(result.saved)
                    yield result, result.saved
    except KeyboardInterrupt:
        for handle in open_handles.values():
            recorder.discard(handle)
        raise


def demonstrations(config: SimConfig, seeds: Sequence[int], *, keep_images: bool = False) -> list[WorkItem]:
    """Return a demonstration of the scripted demonstrator for each seed."""
    scripted = PolicySpec(builtin=SCRIPTED)
    return [WorkItem(policy=scripted, config=config, seed=seed, keep_images=keep_images) for seed in seeds]


def record_all(
    items: Sequence[WorkItem], recorder: SessionRecorder, progress: Progress, *, workers: int, echo: bool = False
) -> list[WorkResult]:
    """Record all items, with a line of progress for each; return those that were lost."""
    lost = []
    with closing(record_items(items, recorder, workers=workers)) as results:
        for result, saved in results:
            seed = result.item.seed
            if result.lost:
                lost.append(result)
                status = f"seed {seed}: lost, {next(iter(result.lost.values()))}"
            else:
                row = next(iter(result.rows.values()))
                outcome = "saved" if saved is None else saved.outcome
                status = f"seed {seed}: {outcome}, contact {min(1.0, row['contact_final']):.2f}"
            if echo and saved is not None:
                print(kept_line(saved), flush=True)
            progress.advance(status=status)
    return lost


def _handle(item: WorkItem) -> JournalHandle:
    if item.handle is None:
        raise ValueError(f"the item of seed {item.seed} has no journal")
    return item.handle


def read_first(item: WorkItem, folder: Path) -> Episode | None:
    """Return the episode of an item with its images, or None where it was lost."""
    path = run_file(folder, item.run_ids[0])
    return read_run(folder, item.run_ids[0], images=True) if path.exists() else None


class EpisodeCollector:
    """Results of a command's episodes, through Ctrl-C and the loss of some."""

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = []
        """Metrics of the finished episodes."""
        self.runs: list[str] = []
        """Names of the finished episodes."""
        self.lost: list[dict[str, Any]] = []
        """Rows of the lost episodes, each with its ``reason``."""
        self._interrupt: KeyboardInterrupt | None = None

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C ended the episodes."""
        return self._interrupt is not None

    @property
    def all_rows(self) -> list[dict[str, Any]]:
        """Rows of finished and lost episodes by seed."""
        return sorted([*self.rows, *self.lost], key=lambda row: int(row["seed"]))

    @contextmanager
    def finish_on_interrupt(self) -> Iterator[None]:
        """End the body on Ctrl-C, and the command only at `check`: what is finished is written before."""
        try:
            yield
        except KeyboardInterrupt as error:
            self._interrupt = error

    def add(self, result: WorkResult, progress: Progress, describe: Callable[[Mapping[str, Any]], str]) -> None:
        """Add the result of an item of one case, with a line of progress that says what ``describe`` says."""
        item, (run,) = result.item, result.item.run_ids
        if run in result.rows:
            self.rows.append(result.rows[run])
            self.runs.append(run)
            progress.advance(status=f"seed {item.seed}: {describe(result.rows[run])}")
        else:
            reason = result.lost.get(run, "its process did not report")
            self.lost.append(crashed_metrics(item.policy.label, item.config, item.seed, item.cases[0].name, reason))
            progress.advance(status=f"seed {item.seed}: lost, {reason}")

    def check(self) -> None:
        """Raise KeyboardInterrupt after Ctrl-C, and LayflatError where episodes are lost."""
        if self._interrupt is not None:
            raise self._interrupt
        if self.lost:
            total = len(self.rows) + len(self.lost)
            reason = self.lost[0]["reason"]
            raise LayflatError(f"{len(self.lost)} of {total} episodes were lost: {reason}; the others are written")
