"""`layflat record`: demonstrations into a session file, each durable the moment it is printed."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import closing
from dataclasses import replace

from layflat.app.support import validators
from layflat.app.support.errors import LayflatError, UsageError
from layflat.app.support.progress import Progress
from layflat.app.support.session_lines import kept_line
from layflat.app.workers.episode_pool import EpisodeConfig, EpisodeFailure, run_enumerated
from layflat.app.workers.record_config import RecordConfig
from layflat.data.session.journal import JournalHandle
from layflat.data.session.recorder import SavedEpisode, SessionRecorder
from layflat.data.types import Episode
from layflat.perception.descriptors.registry import DESCRIPTORS
from layflat.sim.cloth.cloth import CLOTHS
from layflat.sim.robots.registry import robot_spec

EPISODE_S = 15.0
"""Expected wall time of a demonstration, for the first estimate of the time left."""


def record(wish: RecordConfig, *, force: bool, workers: int) -> None:
    """Record what is wished; one line on stdout for each demonstration."""
    if wish.correct is not None and wish.source == "scripted":
        raise UsageError("--correct needs a person who takes over; give --source keyboard or --source gamepad")
    validators.one_of("cloth", wish.cloth, CLOTHS)
    validators.one_of("descriptor", wish.descriptor, DESCRIPTORS)
    path, episodes = wish.path, wish.episodes
    if force and path.exists() and path.is_file():
        raise UsageError(f"record appends to {path} and never replaces it; give another name, or delete it yourself")
    validators.writable_file(path, force=False, append=True)
    if wish.source != "scripted":
        from layflat.app.workstation.session.teleop_record import record_teleoperated

        record_teleoperated(wish)
        return
    jobs = [
        EpisodeConfig(
            robot=wish.robot, cloth=wish.cloth, seed=wish.seed + k, descriptor=wish.descriptor, images=wish.images
        )
        for k in range(episodes)
    ]
    with (
        SessionRecorder(
            path, robot=robot_spec(wish.robot), cloth=wish.cloth, keep_images=wish.images, descriptor=wish.descriptor
        ) as recorder,
        Progress({"demonstrations": EPISODE_S * episodes / workers}) as progress,
    ):
        for kept in recorder.recovered:
            print(kept_line(kept), flush=True)
        progress.phase("demonstrations", items=episodes)
        lost = keep_all(jobs, recorder, progress, workers=workers, echo=True)
    if lost:
        raise LayflatError(f"{len(lost)} of {episodes} demonstrations were lost: {lost[0].reason}; the others are kept")


def keep_all(
    jobs: Sequence[EpisodeConfig], recorder: SessionRecorder, progress: Progress, *, workers: int, echo: bool
) -> list[EpisodeFailure]:
    """Run the jobs and keep each episode as it comes; returns those that did not come back."""
    lost = []
    with closing(run_kept(jobs, recorder, workers=workers)) as results:
        for result, kept in results:
            if isinstance(result, EpisodeFailure):
                lost.append(result)
                status = f"seed {result.job.seed}: lost, {result.reason}"
            else:
                contact = min(1.0, result.final_observation.contact_portion)
                status = f"seed {result.seed}: {result.outcome}, contact {contact:.2f}"
            if echo and kept is not None:
                print(kept_line(kept), flush=True)
            progress.advance(status=status)
    return lost


def run_kept(
    jobs: Sequence[EpisodeConfig], recorder: SessionRecorder, *, workers: int
) -> Generator[tuple[Episode | EpisodeFailure, SavedEpisode | None], None, None]:
    """Results of the jobs, each with where it is kept, durable by then; all have journals while they run.

    Of those that did not come back the recorder keeps what there is, as partial (None: nothing). After Ctrl-C nobody
    wants what was still running.
    """
    journaled = [replace(job, ticket=recorder.ticket()) for job in jobs]
    try:
        with closing(run_enumerated(journaled, workers=workers)) as results:
            for number, result in results:
                ticket = ticket_of(journaled[number])
                if isinstance(result, EpisodeFailure):
                    yield result, recorder.recover(ticket)
                else:
                    yield result, recorder.keep(result, ticket=ticket)
    except KeyboardInterrupt:
        for job in journaled:
            recorder.discard(ticket_of(job))
        raise


def ticket_of(job: EpisodeConfig) -> JournalHandle:
    if job.ticket is None:
        raise ValueError(f"the job of seed {job.seed} has no ticket")
    return job.ticket
