"""Episodes of a station: a fault stops the arm and keeps the episode as partial, with one sentence."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Generator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol

from layflat.app.hardware.station_config import StationError
from layflat.app.hardware.station_environment import StationEnvironment
from layflat.app.support.errors import LayflatError, say
from layflat.app.support.metrics import episode_metrics, write_json
from layflat.app.workers.episode_worker import DEMO
from layflat.app.workers.item_progress import RunningItem
from layflat.app.workers.simulated_episode import EpisodeFactory
from layflat.app.workers.work_item import DisturbanceCase, WorkItem, WorkResult, run_file
from layflat.app.workers.worker_process import Engine, NextWorkItem
from layflat.data.atomic_files import fsync_write
from layflat.data.session.session_writer import serialize
from layflat.data.types import Episode, StoppedBy
from layflat.policy.base import Policy
from layflat.policy.environment import Environment
from layflat.policy.rollout import run_disturbances, run_until_stop
from layflat.policy.runner import EpisodeRunner, StepCallback
from layflat.policy.schedule import DisturbanceScheduler


class PolicyMaker(Protocol):
    """Makes the policy of an episode: a `PolicySpec`, or a person."""

    @property
    def label(self) -> str:
        """Name in records."""

    def make(self, env: Environment) -> Policy:
        """Make the policy for an environment."""


def run_station_episode(
    env: StationEnvironment,
    policy: PolicyMaker,
    seed: int,
    case: DisturbanceCase,
    *,
    keep_images: bool = False,
    on_start: Callable[[Episode], StepCallback] | None = None,
) -> tuple[Episode, str | None]:
    """Run one episode; return it, and why it is partial, or None.

    Ctrl-C holds the arm; the recorder keeps the steps so far when it closes.
    """
    env.reset(seed)
    run = EpisodeRunner(
        env, policy.make(env), seed=seed, disturbance=case.name, keep_images=keep_images, on_start=on_start
    )
    scheduler, reason = DisturbanceScheduler(case.schedule), None
    stopped_by: StoppedBy = "interrupted"
    try:
        stopped_by = run_disturbances(run, scheduler, run_until_stop(run, scheduler))
    except StationError as error:
        reason = str(error)
        env.arm.hold()
    except KeyboardInterrupt:
        env.arm.hold()
        raise
    episode = run.build_episode(stopped_by, None if reason is None else "partial")
    return replace(episode, source=policy.label), reason


def write_commands(path: Path, env: StationEnvironment) -> None:
    """Write every command of the last episode beside it."""
    write_json(path, {"stiffness_n_m": env.config.robot.stiffness_n_m, "commands": env.commands})


def station_engine(env: StationEnvironment) -> Engine:
    """Return the engine of an evaluation on a station: one item after another, a placement for each case."""

    def run(
        next_item: NextWorkItem, folder: Path, make: EpisodeFactory
    ) -> Generator[WorkResult | Sequence[RunningItem], None, None]:
        while (item := next_item()) is not None:
            yield _run_item(env, item, folder)

    return run


def _run_item(env: StationEnvironment, item: WorkItem, folder: Path) -> WorkResult:
    rows, lost = {}, {}
    for case, name in zip(item.cases, item.run_ids, strict=True):
        try:
            episode, reason = run_station_episode(env, item.policy, item.seed, case, keep_images=item.keep_images)
        except StationError as error:
            lost[name] = str(error)
            _recover(env)
            continue
        fsync_write(run_file(folder, name), serialize(DEMO, episode, uuid.uuid4().hex, save_images=item.keep_images))
        write_commands(folder / f"{name}.commands.json", env)
        rows[name] = episode_metrics(episode)
        if reason is not None:
            say(f"{name} is partial: {reason}")
            _recover(env)
    return WorkResult(item=item, lost=lost, rows=rows)


def _recover(env: StationEnvironment) -> None:
    """Get ready for the next episode; LayflatError where the robot does not come back."""
    try:
        env.arm.recover()
        env.camera.frame()
    except StationError as error:
        raise LayflatError(f"{error}; what is finished is kept, and the same command continues from there") from None
