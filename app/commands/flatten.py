"""`layflat flatten`: wrinkle removal from a crumpled start (chapter 3-2-2), by Algorithm 2 or a comparator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace
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
from layflat.app.support.metrics import episode_metrics, write_json
from layflat.app.support.progress import Progress
from layflat.app.support.provenance import capture_provenance
from layflat.app.support.statistics import describe
from layflat.app.workers.episode_collector import EpisodeCollector
from layflat.app.workers.episode_pool import EpisodeConfig, EpisodeFailure, run_episodes
from layflat.data.types import Episode
from layflat.perception.descriptors.registry import DESCRIPTORS
from layflat.policy.scripted.wrinkle_removal import CONTROLLERS
from layflat.sim.cloth.cloth import CLOTHS

EPISODE_S = 14.0
FILM_WIDTH = 640
STRIP_WIDTH = 320
STRIP_COLUMNS = 5


def flatten(
    *,
    controller: str,
    descriptor: str,
    episodes: int,
    seed: int,
    cloth: str,
    video: Path | None,
    strip: Path | None,
    json: Path | None,
    workers: int,
    force: bool,
) -> list[Episode]:
    """Flatten the crumpled starts of ``seed``, ``seed + 1``, ...; a table on stdout, files where asked for.

    ``video`` and ``strip`` show the first seed; what is shown and stored is what the controller saw.
    """
    validators.one_of("controller", controller, CONTROLLERS)
    validators.one_of("descriptor", descriptor, DESCRIPTORS)
    validators.one_of("cloth", cloth, CLOTHS)
    for file, suffix in ((video, ".webm"), (strip, ".png"), (json, None)):
        if file is not None:
            if suffix is not None and file.suffix != suffix:
                raise UsageError(f"{file} is not a {suffix} file; choose a name that ends in {suffix}")
            validators.writable_file(file, force=force)
    jobs = [
        EpisodeConfig(
            robot="pickers",
            cloth=cloth,
            seed=seed + k,
            flatten=controller,
            descriptor=descriptor,
            images=k == 0 and (video is not None or strip is not None),
        )
        for k in range(episodes)
    ]
    harvest = EpisodeCollector()
    with harvest.through_ctrl_c():
        _run(jobs, workers, harvest)
    if not harvest.interrupted:
        pictured = next((episode for episode in harvest.done if episode.seed == seed), None)
        if pictured is not None:
            _write_pictures(pictured, video, strip)
    if json is not None and (harvest.done or not harvest.interrupted):
        write_json(json, _content(controller, descriptor, harvest.done, harvest.lost))
    if harvest.done:
        show(harvest.done)
    return harvest.end()


def _run(jobs: Sequence[EpisodeConfig], workers: int, harvest: EpisodeCollector) -> None:
    with (
        Progress({"flattening": EPISODE_S * len(jobs) / workers}) as progress,
        closing(run_episodes(jobs, workers=workers)) as results,
    ):
        progress.phase("flattening", items=len(jobs))
        harvest.gather(results, progress, _told)


def _told(row: Mapping[str, Any]) -> str:
    return f"contact {row['contact_start']:.2f} to {row['contact_final']:.2f}, {row['stopped_by']}"


def _write_pictures(episode: Episode, video: Path | None, strip_file: Path | None) -> None:
    drawer = PerceptionOverlay()
    if video is not None:
        write_video(video, frames.video_frames(episode, drawer, FILM_WIDTH))
    if strip_file is not None:
        strip = strip_frames(episode, drawer, STRIP_WIDTH)
        write_png(strip_file, frames.contact_sheet([strip[:STRIP_COLUMNS], strip[STRIP_COLUMNS:]]))


def strip_frames(episode: Episode, drawer: PerceptionOverlay, width: int) -> list[frames.Frame]:
    """Ten frames as in Figures 3-6 to 3-8, from the start to the stop, titled with their step."""
    strip = frames.frame_strip(episode, frames.placing_steps(episode), drawer, width)
    return [replace(frame, label=f"step {frame.step}:") for frame in strip]


def _content(
    controller: str, descriptor: str, done: Sequence[Episode], lost: Sequence[EpisodeFailure]
) -> dict[str, Any]:
    """What ``--json`` holds besides the schema: the shared rows, each start's history, the mean."""
    rows = [episode_metrics(episode) for episode in done]
    return {
        "controller": controller,
        "descriptor": descriptor,
        "episodes": rows,
        "starts": [{"seed": episode.seed, **episode.start} for episode in done],
        "summary": _summary(rows),
        "provenance": vars(capture_provenance()),
        "lost": [{"seed": failure.job.seed, "reason": failure.reason} for failure in lost],
    }


def _summary(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """n, and mean, min, max and ci95 (None where there is none) of contact at the start, the end, and in the mesh."""
    summary: dict[str, Any] = {"n": len(rows)}
    for column in ("contact_start", "contact_final", "contact_final_true", "flat_area_final", "steps"):
        summary[column] = describe(np.array([row[column] for row in rows], dtype=float)).to_json()
    return summary


def show(episodes: Sequence[Episode]) -> None:
    """Print one line per episode and their mean on stdout."""
    columns = ("seed", "start", "mesh start", "final", "mesh final", "flat area", "steps", "stopped by")
    lines = []
    for episode in episodes:
        row, mesh_start = episode_metrics(episode), episode.ground_truths()[0].contact_portion_true
        contacts = (row["contact_start"], mesh_start, row["contact_final"], row["contact_final_true"])
        lines.append((*contacts, row["flat_area_final"], row["steps"]))
    rows = [
        (str(episode.seed), *_cells(line, "d"), episode.stopped_by)
        for episode, line in zip(episodes, lines, strict=True)
    ]
    mean = ("mean", *_cells(tuple(np.mean(np.array(lines, dtype=float), axis=0)), ".1f"), "")
    print_table(columns, rows, footer=mean if len(episodes) > 1 else ())


def _cells(line: Sequence[Any], steps_spec: str) -> list[str]:
    *contacts, area, n_steps = line
    return [*map(percent, contacts), ratio(area), format(n_steps, steps_spec)]
