"""A group's episode on the real bench."""

from __future__ import annotations

import time
from dataclasses import replace

from app.batch.plan import SCRIPTED, Case, Entrant, Group
from app.episode import PLACE_TICKS, disturb_and_repair, place
from app.run import Run
from app.schedule import Watch
from data.types import Episode, StoppedBy
from policy import flatten, registry
from policy.base import Policy
from policy.expert import ScriptedExpert
from policy.handover import Handover
from sim.cloth import HELD_STRETCH
from sim.placing import BenchSettings, Placing


class BenchPlay:
    """Made in a process that has not stepped a simulation yet; the bench ends with the process."""

    def __init__(self, group: Group) -> None:
        entrant = group.entrant
        settings = BenchSettings(task=entrant.task, cloth=group.cloth, start=group.start, descriptor=entrant.descriptor)
        bench = Placing(settings)
        bench.reset(group.seed)
        began = time.monotonic()
        self._run = Run(bench, policy_of(entrant, bench), seed=group.seed)
        self._max_ticks = PLACE_TICKS if entrant.controller is None else flatten.TICKS
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
    """Who decides; the demonstrator, who alone sees the mesh, is shown that of ``bench``."""
    if entrant.controller is not None:
        return flatten.controller(entrant.controller)
    if entrant.made == SCRIPTED:
        spec = bench.settings.spec
        return ScriptedExpert(
            entrant.task,
            length_m=spec.length_m,
            columns=spec.columns,
            held_width_m=HELD_STRETCH * spec.width_m,
            look=bench.truth,
        )
    made = None if entrant.made is None else registry.make(entrant.made, entrant.task)
    if entrant.model is None:
        if made is None:
            raise ValueError(f"{entrant.name} is nobody")
        return made
    placer = registry.from_model(entrant.model)
    return placer if made is None else Handover(placer, made, name=entrant.name)
