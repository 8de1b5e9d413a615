"""`layflat record`: demonstrations into a session file, each durable the moment it is printed."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from app import checks
from app.errors import LayflatError, WrongCall
from app.jobs import EpisodeJob, JobFailure, run_jobs
from app.progress import Progress
from data.recorder import SessionRecorder
from data.types import Episode, Task
from sim.cloth import CLOTHS

EPISODE_S = 15.0
"""Expected wall time of a demonstration, for the first estimate of the time left."""


def record(
    path: Path,
    *,
    task: Task,
    cloth: str,
    source: str,
    episodes: int,
    seed: int,
    images: bool,
    force: bool,
    workers: int,
) -> None:
    """Record ``episodes`` demonstrations of seeds ``seed``, ``seed + 1``, ...; one line on stdout for each."""
    checks.known_name("cloth", cloth, CLOTHS)
    checks.known_name("source", source, ("scripted",))
    if force and path.exists() and path.is_file():
        raise WrongCall(f"record appends to {path} and never replaces it; give another name, or delete it yourself")
    checks.writable_file(path, force=False, append=True)
    jobs = [EpisodeJob(task=task, cloth=cloth, seed=seed + k, images=images) for k in range(episodes)]
    with (
        SessionRecorder(path, task=task, cloth=cloth, keep_images=images) as recorder,
        Progress({"demonstrations": EPISODE_S * episodes / workers}) as progress,
    ):
        progress.phase("demonstrations", items=episodes)
        lost = keep_all(jobs, recorder, progress, workers=workers, echo=True)
    if lost:
        raise LayflatError(f"{len(lost)} of {episodes} demonstrations were lost: {lost[0].reason}; the others are kept")


def keep_all(
    jobs: Sequence[EpisodeJob], recorder: SessionRecorder, progress: Progress, *, workers: int, echo: bool
) -> list[JobFailure]:
    """Run the jobs and keep each episode as it comes; returns those that did not come back."""
    lost = []
    with closing(run_jobs(jobs, workers=workers)) as results:
        for result in results:
            if isinstance(result, JobFailure):
                lost.append(result)
                progress.advance(status=f"seed {result.job.seed}: lost, {result.reason}")
                continue
            line = kept_line(recorder, result)
            if echo:
                print(line, flush=True)
            progress.advance(status=f"seed {result.seed}: {result.outcome}, contact {end_contact(result):.2f}")
    return lost


def kept_line(recorder: SessionRecorder, episode: Episode) -> str:
    """Keep an episode and say so, in the words of the contract; only once it is durable."""
    kept = recorder.keep(episode)
    return (
        f"kept {kept.name} {episode.outcome} {len(episode.steps)} ticks contact {end_contact(episode):.2f} {kept.path}"
    )


def end_contact(episode: Episode) -> float:
    return min(1.0, episode.final_observation.contact_portion)
