"""A group's episode on the real bench."""

from __future__ import annotations

import time
from dataclasses import replace

from layflat.app.evaluation.plan import Case, Entrant, Group
from layflat.app.workers.make_policy import player
from layflat.app.workers.rollout import PLACE_TICKS, disturb_and_repair, place
from layflat.app.workers.runner import Run
from layflat.app.workers.schedule import Watch
from layflat.data.types import Episode, StoppedBy
from layflat.policy.base import Policy
from layflat.policy.scripted import wrinkle_removal
from layflat.sim.config import BenchSettings
from layflat.sim.simulation import Placing


class BenchPlay:
    """Made in a process that has not stepped a simulation yet; the bench ends with the process."""

    def __init__(self, group: Group) -> None:
        entrant = group.entrant
        settings = BenchSettings(task=entrant.task, cloth=group.cloth, start=group.start, descriptor=entrant.descriptor)
        bench = Placing(settings)
        bench.reset(group.seed)
        began = time.monotonic()
        self._run = Run(bench, policy_of(entrant, bench), seed=group.seed)
        self._max_ticks = PLACE_TICKS if entrant.controller is None else wrinkle_removal.TICKS
        self._stopped_by: StoppedBy | None = None
        self._wall_s = time.monotonic() - began

    def place(self) -> None:
        self._place(Watch())

    def finish(self, case: Case) -> Episode:
        watch = Watch(case.schedule)
        if self._stopped_by is None:
            self._place(watch)
        began = time.monotonic()
        self._run.disturbance = case.name
        episode = self._run.episode(disturb_and_repair(self._run, watch, self._stopped_by or "tick_limit"))
        # Not the time in which this process waited for the forks before this one.
        return replace(episode, wall_s=self._wall_s + time.monotonic() - began)

    def _place(self, watch: Watch) -> None:
        began = time.monotonic()
        self._stopped_by = place(self._run, watch, max_ticks=self._max_ticks)
        self._wall_s += time.monotonic() - began


def policy_of(entrant: Entrant, bench: Placing) -> Policy:
    """Who decides for ``entrant``."""
    return player(
        bench,
        name=entrant.name,
        model=entrant.model,
        made=entrant.made,
        controller=entrant.controller,
        decorators=entrant.decorators,
    )
