"""Episodes as jobs, each in a process of its own.

Bullet shuffles self-collision impulses with a process-wide seed, so only the first run of a fresh process is
reproducible; and a crash, or a solver that never comes back, then takes one episode with it and no more.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import TimeoutError as FutureTimeoutError
from dataclasses import dataclass
from multiprocessing import get_context

from pebble import ProcessExpired, ProcessPool

from app.errors import LayflatError
from data.types import Episode, Task
from policy import registry
from policy.base import Policy
from policy.expert import ScriptedExpert
from policy.gp_model import GpModel
from sim.cloth import HELD_STRETCH
from sim.placing import BenchSettings, Placing

JOB_LIMIT_S = 900.0
"""Wall time after which an episode counts as hung; a slow machine needs about 30 s."""


@dataclass(frozen=True, kw_only=True)
class EpisodeJob:
    """Everything that determines one episode."""

    task: Task
    cloth: str
    seed: int
    model: GpModel | None = None
    """None: the scripted demonstrator, or the policy named by ``made``."""
    made: str | None = None
    disturbance: str = "none"
    images: bool = False

    @property
    def source(self) -> str:
        return self.model.policy if self.model is not None else self.made or ScriptedExpert.name


@dataclass(frozen=True, kw_only=True)
class JobFailure:
    """An episode that did not come back."""

    job: EpisodeJob
    reason: str


def run_job(job: EpisodeJob) -> Episode:
    """Run one episode here and now; call it once in a process."""
    from app.episode import run_episode

    bench = Placing(BenchSettings(task=job.task, cloth=job.cloth))
    try:
        bench.reset(job.seed)
        return run_episode(bench, policy_of(job, bench), seed=job.seed, disturbance=job.disturbance, images=job.images)
    finally:
        bench.close()


def policy_of(job: EpisodeJob, bench: Placing) -> Policy:
    """Who decides in this job."""
    if job.model is not None:
        return registry.from_model(job.model)
    if job.made is not None:
        return registry.make(job.made, job.task)
    spec = bench.settings.spec
    return ScriptedExpert(
        job.task,
        length_m=spec.length_m,
        columns=spec.columns,
        held_width_m=HELD_STRETCH * spec.width_m,
        look=bench.truth,
    )


def run_jobs(jobs: Sequence[EpisodeJob], *, workers: int) -> Iterator[Episode | JobFailure]:
    """Results in the order of ``jobs``, each as soon as it and those before it are there.

    Every job gets a fresh process, forked from this one, which must never have stepped a simulation. Closing the
    iterator (also by Ctrl-C in the caller) ends the workers.
    """
    # One episode is one core's work: libraries that make threads of their own only get in each other's way.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    pool = ProcessPool(
        max_workers=min(workers, max(len(jobs), 1)),
        max_tasks=1,
        context=get_context("fork"),
        initializer=_prepare_worker,
    )
    finished = False
    try:
        futures = [pool.schedule(run_job, args=[job], timeout=JOB_LIMIT_S) for job in jobs]
        for job, future in zip(jobs, futures, strict=True):
            try:
                yield future.result()
            except FutureTimeoutError:
                yield JobFailure(job=job, reason=f"took more than {JOB_LIMIT_S:.0f} s")
            except ProcessExpired as error:
                yield JobFailure(job=job, reason=f"its process ended with status {error.exitcode}")
        finished = True
    finally:
        pool.close() if finished else pool.stop()
        pool.join()


def episode_of(result: Episode | JobFailure) -> Episode:
    """The episode, or LayflatError for one that did not come back."""
    if isinstance(result, JobFailure):
        job = result.job
        raise LayflatError(f"the {job.source} episode of seed {job.seed} was lost: {result.reason}; try it again")
    return result


def _prepare_worker() -> None:
    # Ctrl-C reaches the whole process group; only the parent decides what to keep and then stops the workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    import cv2

    cv2.setNumThreads(1)
