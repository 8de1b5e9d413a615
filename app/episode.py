"""run_episode: the one loop of recording, placing, disturbing and evaluating; headless, with hooks."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from app.provenance import provenance_now
from data.types import Episode, Observation, Outcome, Phase, Step, StoppedBy, action_size
from policy.base import Policy
from policy.recorded import Recorded
from sim.disturbances import Plan
from sim.placing import Placing

PLACE_TICKS = 160
REPAIR_TICKS = 80
DISTURB_TICKS = 60
"""A disturbance that is not over by then is cut off."""


class Hook(Protocol):
    """Hears of each tick: progress, windows, films."""

    def on_tick(self, step: Step, tick: int) -> None: ...


class _Run:
    """One episode in the making."""

    def __init__(self, bench: Placing, policy: Policy, images: bool, hooks: Sequence[Hook]) -> None:
        self.bench = bench
        self.policy = policy
        self.images = images
        self.hooks = hooks
        self.steps: list[Step] = []
        self.zeros = np.zeros(action_size(bench.settings.task))
        self.seen = bench.observe()
        self.truth = bench.truth()

    def kept(self, observation: Observation) -> Observation:
        return observation if self.images else replace(observation, rgb=None, depth=None)

    def tick(self, phase: Phase) -> StoppedBy | None:
        """observe (done before) -> decide -> step -> record; says why the phase is over, or None."""
        if phase == "disturb":
            action, std, stop = self.zeros, None, None
        else:
            decision = self.policy.act(self.seen)
            action, std, stop = decision.action, decision.std, decision.stop
        step = Step(observation=self.kept(self.seen), truth=self.truth, action=action, action_std=std, phase=phase)
        if stop is None:
            self.bench.step(action)
            self.steps.append(step)
            if self.bench.instability() is not None:
                # The nodes of a diverged cloth may not even be finite: the last sane ones stand for the end.
                return "unstable"
            self.seen, self.truth = self.bench.observe(), self.bench.truth()
            for hook in self.hooks:
                hook.on_tick(step, len(self.steps))
        return stop

    def phase(self, phase: Phase, ticks: int) -> StoppedBy:
        """Ticks until the phase is over; says why."""
        for _ in range(ticks):
            stop = self.tick(phase)
            if stop is not None:
                return stop
            if phase == "disturb" and not self.bench.disturbed:
                break
        return "tick_limit"


def run_episode(
    bench: Placing,
    policy: Policy,
    *,
    seed: int,
    disturbance: str = "none",
    images: bool = False,
    max_ticks: int = PLACE_TICKS,
    hooks: Sequence[Hook] = (),
    begin: Callable[[Episode], Hook] | None = None,
) -> Episode:
    """Place the cloth from the start of ``seed`` until the policy stops; then disturb it, and let the policy go on.

    The bench must have been reset to ``seed``. With ``images`` each step keeps the camera's frame (about 0.5 MB).
    ``begin`` is told the episode before its first tick, and makes a hook of it: a journal (``SessionRecorder.begin``).
    """
    began = time.monotonic()
    policy.reset(seed)
    run = _Run(bench, policy, images, hooks)
    beginning = _beginning(run, seed, disturbance)
    if begin is not None:
        run.hooks = (*hooks, begin(beginning))
    stopped_by = run.phase("place", max_ticks)
    if disturbance != "none" and stopped_by != "unstable":
        bench.disturb(disturbance, seed)
        stopped_by = run.phase("disturb", DISTURB_TICKS)
        if stopped_by != "unstable":
            policy.resume()
            stopped_by = run.phase("repair", REPAIR_TICKS)
    outcome: Outcome = "success" if stopped_by != "unstable" and bench.success() else "failure"
    return replace(
        beginning,
        steps=tuple(run.steps),
        final_observation=run.kept(run.seen),
        final_truth=run.truth,
        stopped_by=stopped_by,
        outcome=outcome,
        wall_s=time.monotonic() - began,
    )


def _beginning(run: _Run, seed: int, disturbance: str) -> Episode:
    """The episode as far as it is known before its first tick."""
    bench, settings = run.bench, run.bench.settings
    return Episode(
        task=settings.task,
        cloth=settings.cloth,
        seed=seed,
        source=run.policy.name,
        steps=(),
        final_observation=run.kept(run.seen),
        final_truth=run.truth,
        stopped_by="interrupted",
        outcome="partial",
        tick_s=settings.tick_s,
        descriptor=settings.descriptor,
        disturbance=disturbance,
        disturbance_plan={} if disturbance == "none" else bench.disturbance_plan(disturbance, seed).described(),
        start=bench.start,
        bench=settings.described(),
        initial_joints=bench.holder.joint_angles(),
        provenance=provenance_now(),
    )


def rerun_episode(bench: Placing, recorded: Episode) -> Episode:
    """Do again what was done in ``recorded``, tick by tick; the same physics gives the same episode to the bit.

    The bench must have been reset to the episode's seed. A disturbance begins where it began, and ends when it ends.
    """
    began = time.monotonic()
    run = _Run(bench, Recorded(recorded), images=False, hooks=())
    phase: Phase = "place"
    for step in recorded.steps:
        if step.phase == "disturb" != phase:
            bench.disturb(recorded.disturbance, recorded.seed)
            if recorded.disturbance_plan and bench.disturbance is not None:
                # As it was: what a name stands for may have changed since.
                bench.disturbance.plan = Plan.recorded(recorded.disturbance_plan, bench.settings.spec)
        phase = step.phase
        if run.tick(phase) is not None:
            break
    return replace(
        recorded,
        steps=tuple(run.steps),
        final_observation=run.kept(run.seen),
        final_truth=run.truth,
        wall_s=time.monotonic() - began,
        provenance=provenance_now(),
    )
