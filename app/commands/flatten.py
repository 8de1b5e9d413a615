"""`layflat flatten`: wrinkle removal from a crumpled start (chapter 3-2-2), by Algorithm 2 or a comparator."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
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
from layflat.app.support.formatting import percent, ratio
from layflat.app.support.metrics import write_json
from layflat.app.support.progress import Progress
from layflat.app.support.statistics import describe
from layflat.app.workers.run_items import CollectedEpisodes, collect_items, read_images
from layflat.app.workers.sim_options import sim_config
from layflat.app.workers.simulated_episode import EpisodeFactory, SimulatedEpisode
from layflat.app.workers.work_item import WorkItem, read_run
from layflat.data.provenance import capture_provenance
from layflat.data.types import Episode
from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR
from layflat.policy.scripted.wrinkle_removal import CONTROLLERS
from layflat.policy.spec import SMOOTH, WORD_CONTROLLER, PolicySpec
from layflat.sim.cloth.spec import DEFAULT_CLOTH

EPISODE_S = 14.0
VIDEO_WIDTH = 640
STRIP_WIDTH = 320
STRIP_COLUMNS = 5
ROBOT = "pickers"
COLUMNS = ("seed", "start", "mesh start", "final", "mesh final", "flat area", "steps", "stopped by")
SUMMARIZED = ("contact_start", "contact_final", "contact_final_true", "flat_area_final", "steps")


@dataclass(frozen=True, kw_only=True)
class FlattenConfig:
    """Settings of one `layflat flatten` call."""

    controller: str = WORD_CONTROLLER
    descriptor: str = DEFAULT_DESCRIPTOR
    cloth: str = DEFAULT_CLOTH
    settings: tuple[str, ...] = ()
    """Conditions, KEY=VALUE."""
    episodes: int = 1
    seed: int = 0
    video: Path | None = None
    """Video of the first episode."""
    strip: Path | None = None
    """Picture with ten frames of the first episode."""
    json: Path | None = None


def flatten(config: FlattenConfig, *, workers: int, force: bool, make: EpisodeFactory = SimulatedEpisode) -> None:
    """Flatten the crumpled starts of ``seed``, ``seed + 1``, ...; print a table, write files where asked for."""
    validators.one_of("controller", config.controller, CONTROLLERS)
    simulation = sim_config(config.settings, robot=ROBOT, task=SMOOTH, cloth=config.cloth, descriptor=config.descriptor)
    for file, suffix in ((config.video, ".webm"), (config.strip, ".png"), (config.json, ".json")):
        if file is not None:
            validators.writable_file(file, suffix=suffix, force=force)
    policy, pictured = PolicySpec(builtin=config.controller), config.video is not None or config.strip is not None
    items = [
        WorkItem(policy=policy, config=simulation, seed=config.seed + k, keep_images=pictured and k == 0)
        for k in range(config.episodes)
    ]
    with tempfile.TemporaryDirectory(prefix="layflat-flatten-") as name:
        folder = Path(name)
        with Progress({"flattening": EPISODE_S * len(items) / workers}) as progress:
            progress.phase("flattening", items=len(items))
            collected = collect_items(items, folder, progress, workers=workers, make=make)
        episodes = [read_run(folder, run) for run in collected.runs]
        first = read_images(items[0], folder) if pictured and collected.interrupt is None else None
        if first is not None:
            _write_pictures(first, config.video, config.strip)
    if config.json is not None and (collected.rows or collected.interrupt is None):
        write_json(config.json, _content(config, episodes, collected))
    if episodes:
        _print_results(episodes, collected.rows)
    collected.check()


def _write_pictures(episode: Episode, video: Path | None, strip_file: Path | None) -> None:
    overlay = PerceptionOverlay(episode.camera)
    if video is not None:
        write_video(video, frames.video_frames(episode, overlay, VIDEO_WIDTH))
    if strip_file is not None:
        strip = strip_frames(episode, overlay, STRIP_WIDTH)
        write_png(strip_file, frames.contact_sheet([strip[:STRIP_COLUMNS], strip[STRIP_COLUMNS:]]))


def strip_frames(episode: Episode, overlay: PerceptionOverlay, width: int) -> list[frames.Frame]:
    """Return ten frames as in Figures 3-6 to 3-8, from the start to the stop, titled with their step."""
    strip = frames.frame_strip(episode, frames.placing_steps(episode), overlay, width)
    return [replace(frame, label=f"step {frame.step}:") for frame in strip]


def _content(config: FlattenConfig, episodes: Sequence[Episode], collected: CollectedEpisodes) -> dict[str, Any]:
    """Return what ``--json`` contains besides the schema: the shared rows, each start, the summary."""
    rows = collected.rows
    summary = {name: describe(np.array([row[name] for row in rows], dtype=float)).to_json() for name in SUMMARIZED}
    return {
        "controller": config.controller,
        "descriptor": config.descriptor,
        "episodes": rows,
        "starts": [{"seed": episode.seed, **episode.start} for episode in episodes],
        "summary": {"n": len(rows), **summary},
        "provenance": vars(capture_provenance()),
        "lost": [{"seed": row["seed"], "reason": row["reason"]} for row in collected.lost],
    }


def _print_results(episodes: Sequence[Episode], rows: Sequence[dict[str, Any]]) -> None:
    """Print one line per episode and their mean."""
    names = ("contact_final", "contact_final_true", "flat_area_final", "steps")
    numbers = [
        (row["contact_start"], episode.ground_truths()[0].contact_portion_true, *(row[name] for name in names))
        for episode, row in zip(episodes, rows, strict=True)
    ]
    lines = [[str(row["seed"]), *_cells(line, "d"), row["stopped_by"]] for line, row in zip(numbers, rows, strict=True)]
    mean = ["mean", *_cells(tuple(np.mean(numbers, axis=0)), ".1f"), ""] if len(rows) > 1 else ()
    print_table(COLUMNS, lines, footer=mean)


def _cells(line: Sequence[Any], steps_form: str) -> list[str]:
    *contacts, area, n_steps = line
    return [*map(percent, contacts), ratio(area), format(n_steps, steps_form)]
