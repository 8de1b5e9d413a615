"""rollout: the one loop of recording, placing, disturbing and evaluating; headless, with hooks."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

from layflat.app.support.provenance import capture_provenance
from layflat.app.workers.runner import EpisodeRunner, StepCallback
from layflat.app.workers.schedule import DisturbanceScheduler, ScheduledDisturbance
from layflat.data.types import Episode, StoppedBy
from layflat.policy.base import Policy, continue_after_disturbance, max_extra_steps
from layflat.policy.scripted.replay import ReplayPolicy
from layflat.sim.disturbances.presets import disturbance_spec
from layflat.sim.simulation import ClothSimulation

PLACE_STEPS = 160
REPAIR_STEPS = 80
DISTURB_STEPS = 60
"""A disturbance that is not over by then is cut off."""


def rollout(
    bench: ClothSimulation,
    policy: Policy,
    *,
    seed: int,
    disturbance: str = "none",
    schedule: Sequence[ScheduledDisturbance] = (),
    images: bool = False,
    max_steps: int = PLACE_STEPS,
    hooks: Sequence[StepCallback] = (),
    begin: Callable[[Episode], StepCallback] | None = None,
) -> Episode:
    """Place the cloth from the start of ``seed`` until the policy stops; then disturb it, and let the policy go on.

    The bench must have been reset to ``seed``. A ``disturbance`` without a schedule comes once, when the policy has
    stopped; with one, it is the name that the episode has for it (else the names of what comes). The rest is as in Run.
    """
    if disturbance != "none" and not schedule:
        schedule = (ScheduledDisturbance(spec=disturbance_spec(disturbance)),)
    if disturbance == "none":
        disturbance = "+".join(dict.fromkeys(item.spec.name for item in schedule)) or "none"
    run = EpisodeRunner(bench, policy, seed=seed, disturbance=disturbance, images=images, hooks=hooks, begin=begin)
    watch = DisturbanceScheduler(schedule)
    stopped_by = run_until_stop(run, watch, max_steps=max_steps)
    return run.episode(run_disturbances(run, watch, stopped_by))


def run_until_stop(
    run: EpisodeRunner, watch: DisturbanceScheduler | None = None, *, max_steps: int = PLACE_STEPS
) -> StoppedBy:
    """Let the policy place until it stops; what falls due meanwhile acts while it goes on, one after another.

    Each disturbance gives it REPAIR_STEPS more. One that is not over when the policy stops is waited for, and the
    policy goes on.
    """
    watch, max_steps = watch or DisturbanceScheduler(), max_steps + max_extra_steps(run.policy)
    while run.n_steps < max_steps + REPAIR_STEPS * len(run.disturbances):
        due = None if run.disturbed else watch.now(run.n_steps, run.seen.contact_portion)
        if due is not None:
            run.disturb(due.spec, due.repeat)
        stop = run.step("place")
        if stop is not None:
            return stop if stop == "unstable" or not run.disturbed else _wait_and_repair(run)
    return "step_limit" if not run.disturbed else _wait_and_repair(run)


def run_disturbances(run: EpisodeRunner, watch: DisturbanceScheduler, stopped_by: StoppedBy) -> StoppedBy:
    """After a placing that was ``stopped_by``: disturb, let the policy repair, and so on until nothing is left.

    A process may be forked before: then each copy goes on from the very same moment.
    """
    if stopped_by == "unstable":
        return stopped_by
    for due in watch.after_stop():
        run.disturb(due.spec, due.repeat)
        stopped_by = _wait_and_repair(run)
        if stopped_by == "unstable":
            break
    return stopped_by


def _wait_and_repair(run: EpisodeRunner) -> StoppedBy:
    """Until the disturbance is over, and then until the policy stops again."""
    stopped_by = run.phase("disturb", DISTURB_STEPS)
    if stopped_by != "unstable":
        continue_after_disturbance(run.policy)
        stopped_by = run.phase("repair", REPAIR_STEPS + max_extra_steps(run.policy))
    return stopped_by


def replay_actions(bench: ClothSimulation, recorded: Episode) -> Episode:
    """Do again what was done in ``recorded``, step by step; the same physics gives the same episode to the bit.

    The bench must have been reset to the episode's seed. Disturbances begin where they began, and end when they end;
    pulls are repeated step by step.
    """
    began = time.monotonic()
    run = EpisodeRunner(bench, ReplayPolicy(recorded), seed=recorded.seed)
    befell = {record.first_step: record for record in recorded.disturbances}
    for step_index, step in enumerate(recorded.steps):
        if step_index in befell:
            run.disturb_as(befell[step_index])
        if run.step(step.phase, step.pull, step.intervention) is not None:
            break
    again = run.episode(recorded.stopped_by, recorded.outcome)
    return replace(
        recorded,
        steps=again.steps,
        disturbances=again.disturbances,
        final_observation=again.final_observation,
        final_ground_truth=again.final_ground_truth,
        wall_s=time.monotonic() - began,
        provenance=capture_provenance(),
    )
