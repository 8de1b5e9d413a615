"""Episodes as jobs, each in a process of its own.

Bullet shuffles self-collision impulses with a process-wide seed, so only the first run of a fresh process is
reproducible; and a crash, or a solver that never comes back, then takes one episode with it and no more.
"""

from __future__ import annotations

import ctypes
import signal
import sys
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import TimeoutError as FutureTimeoutError
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from typing import Any

import cv2
from pebble import ProcessExpired, ProcessFuture, ProcessPool

from layflat.app.workers.interrupts import defer_interrupts
from layflat.app.workers.make_policy import SCRIPTED, make_policy
from layflat.data.session.journal import JournalHandle, JournalWriter
from layflat.data.types import Episode
from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR
from layflat.policy.base import Policy
from layflat.policy.scripted import wrinkle_removal
from layflat.policy.trained_model import TrainedModel
from layflat.sim.cloth.starts import Start
from layflat.sim.config import SimConfig
from layflat.sim.errors import SimError
from layflat.sim.simulation import ClothSimulation

JOB_LIMIT_S = 900.0
"""Wall time after which an episode counts as hung; a slow machine needs about 30 s."""


@dataclass(frozen=True, kw_only=True)
class EpisodeConfig:
    """Everything that determines one episode."""

    robot: str
    cloth: str
    seed: int
    model: TrainedModel | None = None
    """None: the scripted demonstrator, or the policy named by ``made``."""
    made: str | None = None
    """With a model: who takes over after the disturbance."""
    decorators: tuple[str, ...] = ()
    """Of layflat.policy.registry.DECORATORS, what is around the policy."""
    disturbance: str = "none"
    images: bool = False
    flatten: str | None = None
    """A controller of wrinkle removal: from a crumpled start, instead of placing."""
    descriptor: str = DEFAULT_DESCRIPTOR
    """What the observations' ``word`` comes from; a model has its own."""
    ticket: JournalHandle | None = None
    """Leave to write a journal while the episode runs, beside the session that it is for."""

    @property
    def source(self) -> str:
        """Who decides, as in tables and files."""
        if self.flatten is not None:
            return self.flatten
        who = [self.made or SCRIPTED] if self.model is None else [self.model.policy, self.made]
        return "+".join(name for name in (*who, *self.decorators) if name is not None)


@dataclass(frozen=True, kw_only=True)
class EpisodeFailure:
    """An episode that did not come back."""

    job: EpisodeConfig
    reason: str


def run_episode(job: EpisodeConfig) -> Episode:
    """Run one episode here and now; call it once in a process."""
    from layflat.app.workers.rollout import PLACE_STEPS, rollout

    start: Start = "hanging" if job.flatten is None else "crumpled"
    descriptor = job.descriptor if job.model is None else job.model.descriptor
    bench = ClothSimulation(SimConfig(robot=job.robot, cloth=job.cloth, start=start, descriptor=descriptor))
    try:
        bench.reset(job.seed)
        run = partial(
            rollout,
            bench,
            policy_of(job, bench),
            seed=job.seed,
            disturbance=job.disturbance,
            images=job.images,
            max_steps=PLACE_STEPS if job.flatten is None else wrinkle_removal.STEPS,
        )
        return run() if job.ticket is None else _with_journal(run, job.ticket)
    finally:
        bench.close()


def _with_journal(run: Callable[..., Episode], ticket: JournalHandle) -> Episode:
    """``run`` beside a journal, which in the end holds the whole episode, until the session does."""
    with ExitStack() as stack:

        def begin(beginning: Episode) -> JournalWriter:
            journal = ticket.begin(beginning)
            stack.callback(journal.close)
            finish.append(journal.finish)
            return journal

        finish: list[Callable[[Episode], None]] = []
        episode = run(begin=begin)
        for end in finish:
            end(episode)
        return episode


def policy_of(job: EpisodeConfig, bench: ClothSimulation) -> Policy:
    """Who decides in this job."""
    return make_policy(
        bench, name=job.source, model=job.model, made=job.made, controller=job.flatten, decorators=job.decorators
    )


def run_episodes(jobs: Sequence[EpisodeConfig], *, workers: int) -> Generator[Episode | EpisodeFailure, None, None]:
    """Results in the order of ``jobs``, each as soon as it and those before it are there.

    Every job gets a fresh process, forked from this one, which must never have stepped a simulation. Closing the
    iterator ends the workers. Ctrl-C becomes a KeyboardInterrupt only when the result at hand has been dealt with and
    whatever else is finished has come, too.
    """
    with closing(run_enumerated(jobs, workers=workers)) as results:
        for _, result in results:
            yield result


def run_enumerated(
    jobs: Sequence[EpisodeConfig], *, workers: int
) -> Generator[tuple[int, Episode | EpisodeFailure], None, None]:
    """As run_episodes, each result with its job's position: after Ctrl-C some are missing in between."""
    with process_pool(min(workers, max(len(jobs), 1))) as pool:
        futures = [pool.schedule(run_episode, args=[job], timeout=JOB_LIMIT_S) for job in jobs]
        waiting = list(enumerate(zip(jobs, futures, strict=True)))
        try:
            while waiting:
                number, (job, future) = waiting[0]
                result = _result(job, future)
                waiting.pop(0)
                with defer_interrupts():
                    yield number, result
        except KeyboardInterrupt:
            with defer_interrupts():
                yield from [(number, _result(job, future)) for number, (job, future) in waiting if future.done()]
            raise


class _Pool(ProcessPool):
    """Its first robot forks in the caller's thread, which is the one that Ctrl-C comes to."""

    def schedule(self, *args: Any, **kwargs: Any) -> ProcessFuture:
        with defer_interrupts():
            return super().schedule(*args, **kwargs)


@contextmanager
def process_pool(workers: int) -> Iterator[ProcessPool]:
    """A pool that gives every robot a process of its own; left with an error (or Ctrl-C), it ends them at once."""
    # Here, where OpenCV's threads are: a fork that has not got them waits for ever when it is to end them.
    cv2.setNumThreads(1)
    pool = _Pool(max_workers=workers, max_tasks=1, context=get_context("fork"), initializer=_prepare_worker)
    finished = False
    try:
        yield pool
        finished = True
    finally:
        if finished:
            pool.close()  # type: ignore[no-untyped-call]
        else:
            pool.stop()  # type: ignore[no-untyped-call]
        pool.join()


def _result(job: EpisodeConfig, future: ProcessFuture) -> Episode | EpisodeFailure:
    """What came of a job; waits for it."""
    try:
        episode: Episode = future.result()
    except FutureTimeoutError:
        return EpisodeFailure(job=job, reason=f"took more than {JOB_LIMIT_S:.0f} s")
    except ProcessExpired as error:
        return EpisodeFailure(job=job, reason=f"its process ended with status {error.exitcode}")
    except SimError as error:
        return EpisodeFailure(job=job, reason=str(error))
    return episode


def _prepare_worker() -> None:
    # Ctrl-C reaches the whole process group; only the parent decides what to keep and then stops the workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        # A parent that is killed cannot stop its workers; PR_SET_PDEATHSIG makes the system do it.
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)
