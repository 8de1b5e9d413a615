"""`layflat place`: autonomous placing with a trained model, disturbed if wished."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

from layflat.app.commands.record import run_kept
from layflat.app.media.frames import video_frames
from layflat.app.media.perception_overlay import PerceptionOverlay
from layflat.app.media.video import write_video
from layflat.app.support import validators
from layflat.app.support.console import print_table
from layflat.app.support.errors import UsageError
from layflat.app.support.formatting import percent, ratio
from layflat.app.support.metrics import crashed_metrics, episode_metrics, write_json
from layflat.app.support.progress import Progress
from layflat.app.support.provenance import capture_provenance
from layflat.app.support.session_lines import kept_line
from layflat.app.workers.episode_collector import EpisodeCollector
from layflat.app.workers.episode_pool import EpisodeConfig, EpisodeFailure, run_episodes
from layflat.data.session.recorder import SessionRecorder
from layflat.data.types import Episode
from layflat.policy import model_io as model_files
from layflat.policy.registry import WRAPPERS
from layflat.policy.trained_model import TrainedModel
from layflat.sim.cloth.cloth import CLOTHS
from layflat.sim.disturbances.presets import DISTURBANCES

EPISODE_S = 18.0
FILM_WIDTH = 640


def place(
    model: Path,
    *,
    episodes: int,
    seed: int,
    disturb: str | None,
    record: Path | None,
    video: Path | None,
    json: Path | None,
    cloth: str | None,
    around: Sequence[str] = (),
    workers: int,
    force: bool,
) -> list[Episode]:
    """Place with ``model`` from the starts of ``seed``, ``seed + 1``, ...; a table on stdout, files where asked for.

    ``around``: names of layflat.policy.registry.WRAPPERS, the last one outermost.
    """
    validators.readable_file(model, "a model that `layflat train` wrote")
    learned = model_files.load(model)
    cloth = validators.one_of("cloth", cloth or learned.cloth, CLOTHS)
    disturbance = validators.one_of("disturbance", disturb or "none", DISTURBANCES)
    decorators = tuple(validators.one_of("decorator", name, WRAPPERS) for name in around)
    for file, append in ((record, True), (video, False), (json, False)):
        if file is not None:
            validators.writable_file(file, force=force, append=append)
    if video is not None and video.suffix != ".webm":
        raise UsageError(f"{video} is not a .webm file; films are written as .webm")
    jobs = [
        EpisodeConfig(
            robot=learned.layout.robot.name,
            cloth=cloth,
            seed=seed + k,
            model=learned,
            decorators=decorators,
            disturbance=disturbance,
            images=video is not None and k == 0,
        )
        for k in range(episodes)
    ]
    harvest = EpisodeCollector()
    with harvest.through_ctrl_c():
        _run(jobs, learned, cloth, record, workers, harvest)
    filmed = next((episode for episode in harvest.done if episode.seed == seed), None)
    if video is not None and filmed is not None and not harvest.interrupted:
        write_video(video, video_frames(filmed, PerceptionOverlay(), FILM_WIDTH))
    if json is not None and (harvest.done or harvest.lost or not harvest.interrupted):
        write_json(json, _content(harvest.done, harvest.lost))
    if harvest.done:
        show(harvest.done)
    return harvest.end()


def _content(done: Sequence[Episode], lost: Sequence[EpisodeFailure]) -> dict[str, Any]:
    """The rows in the order of their seeds, those of crashed episodes with the reason beside."""
    crashed = [_crashed_row(f.job, f.reason) for f in lost]
    rows = sorted([*map(episode_metrics, done), *crashed], key=lambda row: int(row["seed"]))
    return {"episodes": rows, "provenance": vars(capture_provenance()), "lost": len(lost)}


def _crashed_row(job: EpisodeConfig, reason: str) -> dict[str, Any]:
    return crashed_metrics(
        policy=job.source, robot=job.robot, cloth=job.cloth, seed=job.seed, disturbance=job.disturbance, reason=reason
    )


def _run(
    jobs: list[EpisodeConfig],
    learned: TrainedModel,
    cloth: str,
    record: Path | None,
    workers: int,
    harvest: EpisodeCollector,
) -> None:
    """Run the jobs, and record them if asked to."""
    with ExitStack() as stack:
        recorder = None
        if record is not None:
            recorder = stack.enter_context(
                SessionRecorder(record, robot=learned.layout.robot, cloth=cloth, descriptor=learned.descriptor)
            )
        progress = stack.enter_context(Progress({"placing": EPISODE_S * len(jobs) / workers}))
        for left in recorder.recovered if recorder is not None else ():
            progress.note(kept_line(left))
        results = stack.enter_context(closing(_results(jobs, recorder, progress, workers)))
        progress.phase("placing", items=len(jobs))
        harvest.gather(results, progress, lambda row: f"contact {row['contact_final']:.2f}, {row['stopped_by']}")


def _results(
    jobs: Sequence[EpisodeConfig], recorder: SessionRecorder | None, progress: Progress, workers: int
) -> Generator[Episode | EpisodeFailure, None, None]:
    if recorder is None:
        yield from run_episodes(jobs, workers=workers)
        return
    with closing(run_kept(jobs, recorder, workers=workers)) as results:
        for result, kept in results:
            if kept is not None:
                progress.note(kept_line(kept))
            yield result


def show(episodes: list[Episode]) -> None:
    """Print one line per episode on stdout."""
    rows = []
    for row in map(episode_metrics, episodes):
        contacts = (row["contact_placed"], row["contact_disturbed"], row["contact_final"], row["contact_final_true"])
        area, n_steps = ratio(row["flat_area_final"]), str(row["steps"])
        rows.append((str(row["seed"]), *map(percent, contacts), area, n_steps, row["stopped_by"]))
    print_table(("seed", "placed", "disturbed", "final", "mesh contact", "flat area", "steps", "stopped by"), rows)
