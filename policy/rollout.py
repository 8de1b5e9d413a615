"""Rollouts: the usual order of an episode, for recording, placing and evaluating alike.

An episode has up to three phases: ``place``, until the policy stops; ``disturb``, in which the robot rests; and
``repair``, in which the policy continues. The last two come once for each disturbance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from layflat.data.types import Episode, StoppedBy
from layflat.policy.base import Policy, continue_after_disturbance, max_extra_steps
from layflat.policy.environment import Environment
from layflat.policy.runner import EpisodeRunner, StepCallback
from layflat.policy.schedule import DisturbanceScheduler, ScheduledDisturbance
from layflat.policy.scripted.replay import ReplayPolicy
from layflat.policy.spec import PolicySpec


def rollout(
    env: Environment,
    policy: Policy | PolicySpec,
    *,
    seed: int,
    disturbance: str = "none",
    schedule: Sequence[ScheduledDisturbance] = (),
    keep_images: bool = False,
    max_steps: int | None = None,
    callbacks: Sequence[StepCallback] = (),
    on_start: Callable[[Episode], StepCallback] | None = None,
) -> Episode:
    """Run a policy in an environment for one episode.

    Parameters
    ----------
    env
        The environment; it is reset to ``seed``.
    policy
        A policy for the environment's robot, or what `layflat.load_policy` returned.
    seed
        Seed of the start, the policy and the disturbances.
    disturbance
        Name of a disturbance that starts once, when the policy has stopped. With a ``schedule``, the episode's name
        for what happens.
    schedule
        When which disturbances start.
    keep_images
        Whether each step keeps the camera's frame, about 0.5 MB.
    max_steps
        Most steps until the policy must have stopped; the limit of the environment's task by default.
    callbacks
        Called after every step.
    on_start
        Called with the episode before its first step; returns one more callback, such as a journal.

    Returns
    -------
    Episode
        All steps with what was observed and done; ``contact_final``, ``flat_area_final``, ``outcome``.
    """
    env.reset(seed)
    if isinstance(policy, PolicySpec):
        policy = policy.make(env)
    if disturbance != "none" and not schedule:
        schedule = (ScheduledDisturbance(disturbance=disturbance),)
    if disturbance == "none":
        disturbance = "+".join(dict.fromkeys(item.name for item in schedule)) or "none"
    run = EpisodeRunner(
        env, policy, seed=seed, disturbance=disturbance, keep_images=keep_images, callbacks=callbacks, on_start=on_start
    )
    scheduler = DisturbanceScheduler(schedule)
    stopped_by = run_until_stop(run, scheduler, max_steps=max_steps)
    return run.build_episode(run_disturbances(run, scheduler, stopped_by))


def run_until_stop(
    run: EpisodeRunner, scheduler: DisturbanceScheduler | None = None, *, max_steps: int | None = None
) -> StoppedBy:
    """Place until the policy stops; disturbances that fall due act meanwhile, one after another.

    Each of them gives the policy the steps of one more repair. One that still acts when the policy stops is waited
    for, and the policy continues.
    """
    scheduler, limits = scheduler or DisturbanceScheduler(), run.env.spec.limits
    most = (limits.place if max_steps is None else max_steps) + max_extra_steps(run.policy)
    while run.n_steps < most + limits.repair * len(run.disturbances):
        due = None if run.disturbed else scheduler.pop_due(run.n_steps, run.observation.contact_portion)
        if due is not None:
            run.disturb(due.disturbance, due.repeat)
        stop = run.step("place")
        if stop is not None:
            return stop if stop == "unstable" or not run.disturbed else _wait_and_repair(run)
    return "step_limit" if not run.disturbed else _wait_and_repair(run)


def run_disturbances(run: EpisodeRunner, scheduler: DisturbanceScheduler, stopped_by: StoppedBy) -> StoppedBy:
    """After a placement that was ``stopped_by``: disturb and let the policy repair, until no disturbance is left.

    A process may be forked before this call: each copy continues from the same state.
    """
    if stopped_by == "unstable":
        return stopped_by
    for due in scheduler.remaining_after_stop():
        run.disturb(due.disturbance, due.repeat)
        stopped_by = _wait_and_repair(run)
        if stopped_by == "unstable":
            break
    return stopped_by


def _wait_and_repair(run: EpisodeRunner) -> StoppedBy:
    """Wait until the disturbance is over, then run the policy until it stops again."""
    limits = run.env.spec.limits
    stopped_by = run.run_phase("disturb", limits.disturb)
    if stopped_by != "unstable":
        continue_after_disturbance(run.policy)
        stopped_by = run.run_phase("repair", limits.repair + max_extra_steps(run.policy))
    return stopped_by


def replay_actions(env: Environment, recorded: Episode) -> Episode:
    """Repeat the actions of ``recorded`` step by step; the same physics gives the same episode to the bit.

    Disturbances start where they started and end when they end; drags are repeated step by step.
    """
    env.reset(recorded.seed)
    run = EpisodeRunner(env, ReplayPolicy(recorded), seed=recorded.seed)
    records = {record.first_step: record for record in recorded.disturbances}
    for step_index, step in enumerate(recorded.steps):
        if step_index in records:
            run.disturb(records[step_index])
        if run.step(step.phase, step.drag, step.intervention) is not None:
            break
    again = run.build_episode(recorded.stopped_by, recorded.outcome)
    new = ("steps", "disturbances", "final_observation", "final_ground_truth", "wall_s", "provenance")
    return replace(recorded, **{name: getattr(again, name) for name in new})
