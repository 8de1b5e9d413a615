"""Run work items of one case each on this machine: results in order, rows, and recordings."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from layflat.app.support.errors import LayflatError
from layflat.app.support.metrics import crashed_metrics, episode_metrics
from layflat.app.support.progress import Progress
from layflat.app.workers.interrupts import note_interrupts
from layflat.app.workers.item_progress import ItemProgress, RunningItem
from layflat.app.workers.simulated_episode import EpisodeFactory, SimulatedEpisode
from layflat.app.workers.work_item import WorkItem, WorkResult, read_run, run_file
from layflat.app.workers.worker_process import local_engine
from layflat.data.errors import WriteError
from layflat.data.session.journal import JournalHandle
from layflat.data.session.recorder import SessionRecorder
from layflat.data.session.saved_episode import SavedEpisode
from layflat.data.types import Episode
from layflat.policy.spec import SCRIPTED, PolicySpec
from layflat.sim.conditions.variation import NO_VARIATION, Variation
from layflat.sim.config import SimConfig


def demonstrations(
    config: SimConfig, seeds: Sequence[int], *, keep_images: bool = False, variation: Variation = NO_VARIATION
) -> list[WorkItem]:
    """Return a demonstration of the scripted demonstrator for each seed, which draws the conditions that vary."""
    scripted = PolicySpec(builtin=SCRIPTED)
    return [
        WorkItem(policy=scripted, config=config.under(variation.sample(seed)), seed=seed, keep_images=keep_images)
        for seed in seeds
    ]


def run_items(
    items: Iterable[WorkItem],
    folder: Path,
    *,
    workers: int,
    make: EpisodeFactory = SimulatedEpisode,
    on_running: Callable[[Sequence[RunningItem]], None] = lambda running: None,
) -> Generator[WorkResult, None, None]:
    """Yield the results in the order of ``items``, each as soon as it and those before it are there.

    An item is taken from ``items`` when a worker is free for it; ``on_running`` is called in between. Ctrl-C becomes a
    KeyboardInterrupt only when the caller has dealt with the result at hand, and with those that are finished besides.
    Closing ends the workers.
    """
    waiting, started, finished = iter(items), list[WorkItem](), dict[int, WorkResult]()
    position = 0

    def next_item() -> WorkItem | None:
        item = next(waiting, None)
        if item is not None:
            started.append(item)
        return item

    with note_interrupts() as interrupts, closing(local_engine(workers)(next_item, folder, make)) as results:
        for result in results:
            if isinstance(result, WorkResult):
                place = next(k for k, item in enumerate(started) if item is result.item)
                finished[place] = result
            else:
                on_running(result)
            while position in finished:
                yield finished.pop(position)
                position += 1
            if interrupts.received:
                break
        yield from (finished[k] for k in sorted(finished))
        if interrupts.received:
            raise KeyboardInterrupt


@dataclass
class CollectedEpisodes:
    """Episodes of a command, through Ctrl-C and the loss of some."""

    rows: list[dict[str, Any]] = field(default_factory=list)
    """Metrics of the finished episodes, by seed."""
    runs: list[str] = field(default_factory=list)
    """Their names, in the same order."""
    lost: list[dict[str, Any]] = field(default_factory=list)
    """Rows of the lost episodes, each with its ``reason``."""
    interrupt: KeyboardInterrupt | None = None
    """The Ctrl-C that ended the episodes."""

    @property
    def all_rows(self) -> list[dict[str, Any]]:
        """Rows of finished and lost episodes by seed."""
        return sorted([*self.rows, *self.lost], key=lambda row: int(row["seed"]))

    def check(self) -> None:
        """Raise KeyboardInterrupt after Ctrl-C, and LayflatError where episodes are lost."""
        if self.interrupt is not None:
            raise self.interrupt
        if self.lost:
            total = len(self.rows) + len(self.lost)
            reason = self.lost[0]["reason"]
            raise LayflatError(f"{len(self.lost)} of {total} episodes were lost: {reason}; the others are kept")


def collect_items(
    items: Sequence[WorkItem],
    folder: Path,
    progress: Progress,
    *,
    workers: int,
    recorder: SessionRecorder | None = None,
    on_saved: Callable[[SavedEpisode], None] = lambda saved: None,
    make: EpisodeFactory = SimulatedEpisode,
) -> CollectedEpisodes:
    """Run all items, into a session if there is a ``recorder``; Ctrl-C ends them, and is raised by the result's check.

    ``progress`` is in a phase whose items are these. Every episode that is recorded has a journal while it runs;
    ``on_saved`` is called when it is durable, and for what there is of an episode that was lost. After Ctrl-C the
    episodes that were still running are discarded. WriteError where the session cannot be written any more.
    """
    collected, journals, done = CollectedEpisodes(), list[JournalHandle](), ItemProgress(progress, len(items))

    def with_journals(recorder: SessionRecorder) -> Iterator[WorkItem]:
        for item in items:
            journals.append(recorder.new_journal())
            yield replace(item, handle=journals[-1])

    try:
        tasks = items if recorder is None else with_journals(recorder)
        running = run_items(tasks, folder, workers=workers, make=make, on_running=done.show_running)
        with closing(running) as results:
            for result in results:
                handle = result.item.handle
                if recorder is not None and handle is not None:
                    journals.remove(handle)
                    saved = recorder.recover(handle) if result.saved is None else recorder.register(result.saved)
                    if saved is not None:
                        on_saved(saved)
                _add(collected, result, folder, done)
                if handle is not None and result.unwritable is not None:
                    raise WriteError(result.unwritable)
    except KeyboardInterrupt as error:
        collected.interrupt = error
        if recorder is not None:
            for handle in journals:
                recorder.discard(handle)
    return collected


def _add(collected: CollectedEpisodes, result: WorkResult, folder: Path, progress: ItemProgress) -> None:
    item, (run,) = result.item, result.item.run_ids
    if run in result.lost:
        reason = result.lost[run]
        collected.lost.append(crashed_metrics(item.policy.label, item.config, item.seed, item.cases[0].name, reason))
        progress.finish(1, f"seed {item.seed}: lost, {reason}")
    else:
        row = result.rows.get(run) or episode_metrics(read_run(folder, run))
        collected.rows.append(row)
        collected.runs.append(run)
        contact = f"contact {row['contact_start']:.2f} to {row['contact_final']:.2f}"
        progress.finish(1, f"seed {item.seed}: {contact}, {row['stopped_by']}")


def read_images(item: WorkItem, folder: Path) -> Episode | None:
    """Return the episode of an item with its images, or None where it was lost."""
    path = run_file(folder, item.run_ids[0])
    return read_run(folder, item.run_ids[0], images=True) if path.exists() else None
