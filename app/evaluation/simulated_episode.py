"""A group's episode on the real bench."""

from __future__ import annotations

import time
from dataclasses import replace

from layflat.app.evaluation.plan import DisturbanceCase, PolicySpec, WorkItem
from layflat.app.workers.make_policy import make_policy
from layflat.app.workers.rollout import PLACE_STEPS, run_disturbances, run_until_stop
from layflat.app.workers.runner import EpisodeRunner
from layflat.app.workers.schedule import DisturbanceScheduler
from layflat.data.types import Episode, StoppedBy
from layflat.policy.base import Policy
from layflat.policy.scripted import wrinkle_removal
from layflat.sim.config import SimConfig
from layflat.sim.simulation import ClothSimulation


class SimulatedEpisode:
    """Made in a process that has not stepped a simulation yet; the bench ends with the process."""

    def __init__(self, group: WorkItem) -> None:
        entrant = group.entrant
        settings = SimConfig(robot=entrant.robot, cloth=group.cloth, start=group.start, descriptor=entrant.descriptor)
        bench = ClothSimulation(settings)
        bench.reset(group.seed)
        began = time.monotonic()
        self._run = EpisodeRunner(bench, policy_of(entrant, bench), seed=group.seed)
        self._max_steps = PLACE_STEPS if entrant.controller is None else wrinkle_removal.STEPS
        self._stopped_by: StoppedBy | None = None
        self._wall_s = time.monotonic() - began

    def run_until_stop(self) -> None:
        self._place(DisturbanceScheduler())

    def finish(self, case: DisturbanceCase) -> Episode:
        watch = DisturbanceScheduler(case.schedule)
        if self._stopped_by is None:
            self._place(watch)
        began = time.monotonic()
        self._run.disturbance = case.name
        episode = self._run.episode(run_disturbances(self._run, watch, self._stopped_by or "step_limit"))
        # Not the time in which this process waited for the forks before this one.
        return replace(episode, wall_s=self._wall_s + time.monotonic() - began)

    def _place(self, watch: DisturbanceScheduler) -> None:
        began = time.monotonic()
        self._stopped_by = run_until_stop(self._run, watch, max_steps=self._max_steps)
        self._wall_s += time.monotonic() - began


def policy_of(entrant: PolicySpec, bench: ClothSimulation) -> Policy:
    """Who decides for ``entrant``."""
    return make_policy(
        bench,
        name=entrant.name,
        model=entrant.model,
        made=entrant.made,
        controller=entrant.controller,
        decorators=entrant.decorators,
    )
