"""SimulatedEpisode: the episode of a work item in a simulation."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol, TypeAlias

from layflat.app.workers.work_item import DisturbanceCase, WorkItem
from layflat.data.types import Episode, StoppedBy
from layflat.policy.environment import Environment
from layflat.policy.rollout import run_disturbances, run_until_stop
from layflat.policy.runner import EpisodeRunner, StepCallback
from layflat.policy.schedule import DisturbanceScheduler
from layflat.sim.config import SimConfig
from layflat.sim.simulation import ClothSimulation


class ForkableEpisode(Protocol):
    """An episode that can be continued in several ways from the moment when the policy stops."""

    def run_until_stop(self) -> None:
        """Place until the policy stops."""

    def run_case(self, case: DisturbanceCase) -> Episode:
        """Run what follows, and the placement first where it has not been run yet."""


EpisodeFactory: TypeAlias = Callable[[WorkItem, Callable[[Episode], StepCallback] | None], ForkableEpisode]
"""Starts the episode of a work item; the callback is ``on_start`` of the runner."""


class SimulatedEpisode:
    """An episode in a simulation that ends with its process, which must not have stepped a simulation before."""

    def __init__(
        self,
        item: WorkItem,
        on_start: Callable[[Episode], StepCallback] | None = None,
        *,
        make_env: Callable[[SimConfig], Environment] = ClothSimulation,
    ) -> None:
        env = make_env(item.config)
        env.reset(item.seed)
        started_s = time.monotonic()
        names = {case.name for case in item.cases}
        self._run = EpisodeRunner(
            env,
            item.policy.make(env),
            seed=item.seed,
            disturbance=names.pop() if len(names) == 1 else "none",
            keep_images=item.keep_images,
            on_start=on_start,
        )
        self._stopped_by: StoppedBy | None = None
        self._wall_s = time.monotonic() - started_s

    def run_until_stop(self) -> None:
        """Place until the policy stops."""
        self._place(DisturbanceScheduler())

    def run_case(self, case: DisturbanceCase) -> Episode:
        """Run what follows, and the placement first where it has not been run yet."""
        scheduler = DisturbanceScheduler(case.schedule)
        if self._stopped_by is None:
            self._place(scheduler)
        started_s = time.monotonic()
        self._run.disturbance = case.name
        stopped_by = run_disturbances(self._run, scheduler, self._stopped_by or "step_limit")
        # Without the time in which this process waited for the forks before this one.
        return replace(self._run.build_episode(stopped_by), wall_s=self._wall_s + time.monotonic() - started_s)

    def _place(self, scheduler: DisturbanceScheduler) -> None:
        started_s = time.monotonic()
        self._stopped_by = run_until_stop(self._run, scheduler)
        self._wall_s += time.monotonic() - started_s
