"""`layflat flatten`: wrinkle removal from a crumpled start (chapter 3-2-2), by Algorithm 2 or a comparator."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from layflat.app.media import frames
from layflat.app.media.perception_overlay import PerceptionOverlay
from layflat.app.media.png import write_png
from layflat.app.media.video import write_video
from layflat.app.support import validators
from layflat.app.support.console import print_table
from layflat.app.support.errors import UsageError
from layflat.app.support.formatting import percent, ratio
from layflat.app.support.metrics import write_json
from layflat.app.support.progress import Progress
from layflat.app.support.statistics import describe
from layflat.app.workers.run_items import EpisodeCollector, read_first, run_items
from layflat.app.workers.work_item import WorkItem, read_run
from layflat.data.provenance import capture_provenance
from layflat.data.types import Episode
from layflat.perception.descriptors.registry import DESCRIPTORS
from layflat.policy.scripted.wrinkle_removal import CONTROLLERS
from layflat.policy.spec import SMOOTH, PolicySpec
from layflat.sim.cloth.spec import CLOTHS
from layflat.sim.config import SimConfig

EPISODE_S = 14.0
FILM_WIDTH = 640
STRIP_WIDTH = 320
STRIP_COLUMNS = 5
ROBOT = "pickers"
COLUMNS = ("seed", "start", "mesh start", "final", "mesh final", "flat area", "steps", "stopped by")


@dataclass(frozen=True, kw_only=True)
class FlattenConfig:
    """Settings of one `layflat flatten` call."""

    controller: str
    descriptor: str
    cloth: str
    episodes: int = 1
    seed: int = 0
    video: Path | None = None
    strip: Path | None = None
    json: Path | None = None


def flatten(config: FlattenConfig, *, workers: int, force: bool) -> None:
    """Flatten the crumpled starts of ``seed``, ``seed + 1``, ...; print a table, write files where asked for.

    ``video`` and ``strip`` show the first seed; what is shown and stored is what the controller saw.
    """
    validators.one_of("controller", config.controller, CONTROLLERS)
    validators.one_of("descriptor", config.descriptor, DESCRIPTORS)
    validators.one_of("cloth", config.cloth, CLOTHS)
    for file, suffix in ((config.video, ".webm"), (config.strip, ".png"), (config.json, None)):
        if file is not None:
            if suffix is not None and file.suffix != suffix:
                raise UsageError(f"{file} is not a {suffix} file; choose a name that ends in {suffix}")
            validators.writable_file(file, force=force)
    pictured = config.video is not None or config.strip is not None
    simulation = SimConfig(robot=ROBOT, task=SMOOTH, cloth=config.cloth, descriptor=config.descriptor)
    policy = PolicySpec(builtin=config.controller)
    items = [
        WorkItem(policy=policy, config=simulation, seed=config.seed + k, keep_images=pictured and k == 0)
        for k in range(config.episodes)
    ]
    collector = EpisodeCollector()
    with tempfile.TemporaryDirectory(prefix="layflat-flatten-") as name:
        folder = Path(name)
        with (
            collector.finish_on_interrupt(),
            Progress({"flattening": EPISODE_S * len(items) / workers}) as progress,
            closing(run_items(items, folder, workers=workers)) as results,
        ):
            progress.phase("flattening", items=len(items))
            for result in results:
                collector.add(result, progress, _describe)
        episodes = [read_run(folder, run) for run in collector.runs]
        first = read_first(items[0], folder) if pictured and not collector.interrupted else None
        if first is not None:
            _write_pictures(first, config.video, config.strip)
    if config.json is not None and (collector.rows or not collector.interrupted):
        write_json(config.json, _content(config, episodes, collector))
    if collector.rows:
        _print_results(episodes, collector.rows)
    collector.check()


def _describe(row: Mapping[str, Any]) -> str:
    return f"contact {row['contact_start']:.2f} to {row['contact_final']:.2f}, {row['stopped_by']}"


def _write_pictures(episode: Episode, video: Path | None, strip_file: Path | None) -> None:
    overlay = PerceptionOverlay()
    if video is not None:
        write_video(video, frames.video_frames(episode, overlay, FILM_WIDTH))
    if strip_file is not None:
        strip = strip_frames(episode, overlay, STRIP_WIDTH)
        write_png(strip_file, frames.contact_sheet([strip[:STRIP_COLUMNS], strip[STRIP_COLUMNS:]]))


def strip_frames(episode: Episode, overlay: PerceptionOverlay, width: int) -> list[frames.Frame]:
    """Return ten frames as in Figures 3-6 to 3-8, from the start to the stop, titled with their step."""
    strip = frames.frame_strip(episode, frames.placing_steps(episode), overlay, width)
    return [replace(frame, label=f"step {frame.step}:") for frame in strip]


def _content(config: FlattenConfig, episodes: Sequence[Episode], collector: EpisodeCollector) -> dict[str, Any]:
    """Return what ``--json`` contains besides the schema: the shared rows, each start, the summary."""
    return {
        "controller": config.controller,
        "descriptor": config.descriptor,
        "episodes": collector.rows,
        "starts": [{"seed": episode.seed, **episode.start} for episode in episodes],
        "summary": _summary(collector.rows),
        "provenance": vars(capture_provenance()),
        "lost": [{"seed": row["seed"], "reason": row["reason"]} for row in collector.lost],
    }


def _summary(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return n, and mean, min, max and ci95 (None where there is none) of contact, flat area and steps."""
    summary: dict[str, Any] = {"n": len(rows)}
    for column in ("contact_start", "contact_final", "contact_final_true", "flat_area_final", "steps"):
        summary[column] = describe(np.array([row[column] for row in rows], dtype=float)).to_json()
    return summary


def _print_results(episodes: Sequence[Episode], rows: Sequence[dict[str, Any]]) -> None:
    """Print one line per episode and their mean."""
    numbers = [
        (
            row["contact_start"],
            episode.ground_truths()[0].contact_portion_true,
            row["contact_final"],
            row["contact_final_true"],
            row["flat_area_final"],
            row["steps"],
        )
        for episode, row in zip(episodes, rows, strict=True)
    ]
    lines = [[str(row["seed"]), *_cells(line, "d"), row["stopped_by"]] for line, row in zip(numbers, rows, strict=True)]
    mean = ["mean", *_cells(tuple(np.mean(numbers, axis=0)), ".1f"), ""] if len(rows) > 1 else ()
    print_table(COLUMNS, lines, footer=mean)


def _cells(line: Sequence[Any], steps_form: str) -> list[str]:
    *contacts, area, n_steps = line
    return [*map(percent, contacts), ratio(area), format(n_steps, steps_form)]
