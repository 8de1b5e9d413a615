"""Rollouts step by step: what happens is in the episode, with its steps, and it runs again to the bit."""

from __future__ import annotations

import copy
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from layflat.app.commands.replay import compare
from layflat.data import SessionRecorder, open_session, validate
from layflat.data.session.journal_reader import read_journal
from layflat.data.session.parts import journals, parts_folder
from layflat.data.types import DragTarget
from layflat.policy.base import Decision
from layflat.policy.rollout import replay_actions, rollout, run_disturbances, run_until_stop
from layflat.policy.runner import EpisodeRunner
from layflat.policy.schedule import DisturbanceScheduler, ScheduledDisturbance, Trigger
from layflat.sim.config import SimConfig
from layflat.tests.fake_environment import ACTING_STEPS, FakeEnvironment, ForwardPolicy

SEED = 3


def make_env(robot="hanger", diverges_at=None) -> FakeEnvironment:
    env = FakeEnvironment(SimConfig(robot=robot, cloth="towel"))
    env.reset(SEED)
    env.diverges_at = diverges_at
    return env


@pytest.fixture
def env() -> FakeEnvironment:
    return make_env()


def scheduled(name="thesis", **options) -> ScheduledDisturbance:
    return ScheduledDisturbance(disturbance=name, **options)


def at(kind, value, name="wind", **options) -> ScheduledDisturbance:
    return scheduled(name, trigger=Trigger(kind=kind, value=value), **options)


def run(env, *schedule, policy=None, disturbance="none"):
    return rollout(env, policy or ForwardPolicy(), seed=SEED, schedule=schedule, disturbance=disturbance)


def phases(episode) -> list[str]:
    return [step.phase for step in episode.steps]


def through_a_file(episode, path):
    with SessionRecorder(path, robot=episode.robot, cloth=episode.cloth) as recorder:
        recorder.save(episode)
    assert validate(path) == ()
    with open_session(path) as session:
        return session[0]


def test_a_named_disturbance_starts_once_after_the_stop(env):
    policy = ForwardPolicy()
    episode = run(env, policy=policy, disturbance="thesis")
    (record,) = episode.disturbances
    first, end = episode.phase_bounds("disturb")
    assert (record.name, record.first_step, record.last_step) == ("thesis", first, end - 1)
    assert end - first == ACTING_STEPS
    assert record.plan == make_env().disturb("thesis").plan
    assert policy.continued == 1
    assert phases(episode) == sorted(phases(episode), key=("place", "disturb", "repair").index)
    assert (episode.stopped_by, episode.disturbance) == ("converged", "thesis")
    acting = [bool(step.force_n.any()) for step in episode.steps]
    assert acting == [step.phase == "disturb" for step in episode.steps]
    assert all(step.action.any() == (step.phase != "disturb") for step in episode.steps)


def test_repeats_come_one_after_another_each_drawn_on_its_own(env):
    episode = run(env, scheduled(repeats=3), disturbance="thesis")
    names = phases(episode)
    changes = [a for a, b in zip(names, ["", *names], strict=False) if a != b]
    assert changes == ["place", *["disturb", "repair"] * 3]
    assert len({str(record.plan) for record in episode.disturbances}) == 3
    for record in episode.disturbances:
        assert names[record.first_step : record.last_step + 1] == ["disturb"] * ACTING_STEPS


def test_one_at_a_step_or_at_a_contact_acts_while_the_policy_continues(env):
    episode = run(env, at("step", 5), disturbance="gust")
    (record,) = episode.disturbances
    assert (record.name, record.first_step, record.last_step) == ("wind", 5, 4 + ACTING_STEPS)
    assert set(phases(episode)) == {"place"}
    assert all(step.action.any() for step in episode.steps)
    assert episode.disturbance == "gust"
    episode = run(env, at("contact", 0.25))
    (record,) = episode.disturbances
    assert episode.disturbance == "wind"
    contact = episode.contact()
    assert contact[record.first_step] >= 0.25
    assert contact[: record.first_step].max() < 0.25


def test_one_that_still_acts_when_the_policy_stops_is_waited_for(env):
    policy, stops = ForwardPolicy(), iter([*[None] * 10, "threshold", *[None] * 3, "converged"])
    policy.act = lambda seen: Decision(action=[0.01, 0.0], stop=next(stops))
    episode = run(env, at("step", 9), policy=policy)
    (record,) = episode.disturbances
    assert phases(episode) == ["place"] * 10 + ["disturb"] * (ACTING_STEPS - 1) + ["repair"] * 3
    assert (record.first_step, record.last_step) == (9, 8 + ACTING_STEPS)
    assert (episode.stopped_by, policy.continued) == ("converged", 1)


def test_those_due_together_come_in_turn_and_a_step_not_reached_after_the_stop_but_a_contact_never(env):
    episode = run(env, at("step", 5), at("step", 5, "push"), scheduled("poke"))
    starts = [(record.name, record.first_step) for record in episode.disturbances]
    assert starts == [("wind", 5), ("push", 5 + ACTING_STEPS), ("poke", episode.phase_bounds("disturb")[0])]
    episode = run(env, at("contact", 0.9), at("step", 900, repeats=2))
    assert [record.name for record in episode.disturbances] == ["wind", "wind"]
    assert episode.phase_bounds("place")[1] == episode.disturbances[0].first_step


def test_disturbances_are_drawn_by_the_schedule_whatever_order_they_start_in():
    """Two policies that reach the triggers in another order meet the same disturbances."""
    schedule = [at("contact", 0.3), at("step", 8, "push"), scheduled("poke", repeats=2)]
    slow, quick = ForwardPolicy(), ForwardPolicy()
    quick.act = lambda seen: replace(ForwardPolicy.act(quick, seen), action=np.array([0.02, 0.0]))
    plans, orders = [], []
    for policy in (slow, quick):
        records = run(make_env(), *schedule, policy=policy).disturbances
        orders.append([record.name for record in records])
        plans.append(sorted((record.name, str(record.plan)) for record in records))
    assert orders[0] != orders[1]
    assert plans[0] == plans[1]


def test_copies_of_a_placement_continue_as_an_episode_that_was_never_copied():
    placed = EpisodeRunner(make_env(), ForwardPolicy(), seed=SEED)
    stopped_by = run_until_stop(placed)
    for name in ("none", "push", "wind"):
        copied = copy.deepcopy(placed)
        copied.disturbance = name
        schedule = [] if name == "none" else [scheduled(name)]
        episode = copied.build_episode(run_disturbances(copied, DisturbanceScheduler(schedule), stopped_by))
        whole = run(make_env(), disturbance=name)
        assert compare(whole, episode).identical
        assert (episode.disturbance, episode.disturbances) == (name, whole.disturbances)


def test_a_cloth_that_diverges_ends_the_episode_and_its_disturbance_has_no_end():
    # Its last observation stands: those of a diverged cloth may not even be finite.
    episode = run(make_env(diverges_at=7), at("step", 5), scheduled(), disturbance="gust")
    (record,) = episode.disturbances
    assert (episode.stopped_by, episode.outcome, len(episode.steps)) == ("unstable", "failure", 7)
    assert (record.first_step, record.last_step) == (5, None)
    assert not episode.steps[-1].force_n.any()
    assert episode.final_observation.time_s == episode.steps[-1].observation.time_s


def test_a_disturbance_gives_the_policy_the_steps_of_one_more_repair(env):
    """A policy that never stops is stopped at the task's limits, which are the same for every driver."""
    never = ForwardPolicy(enough=9.0)
    limits = env.spec.limits
    episode = run(env, at("step", 5), policy=never)
    assert len(episode.steps) == limits.place + limits.repair
    assert episode.stopped_by == "step_limit"
    episode = run(env, policy=never, disturbance="wind")
    assert phases(episode).count("place") == limits.place
    assert phases(episode).count("repair") == limits.repair
    assert len(rollout(env, never, seed=SEED, max_steps=7).steps) == 7


def test_one_that_is_replaced_before_it_acts_is_not_recorded(env):
    runner = EpisodeRunner(env, ForwardPolicy(), seed=SEED)
    runner.step("place")
    runner.disturb("wind")
    runner.disturb("push")
    runner.step("place")
    runner.disturb("poke")
    runner.step("place")
    found = [(record.name, record.first_step, record.last_step) for record in runner.disturbances]
    assert found == [("push", 1, 1), ("poke", 2, None)]


def driven(env, n_steps=12):
    """Run an episode by hand: drag for three steps, release, drag elsewhere, disturb; at the end guide the robot."""
    policy = ForwardPolicy()
    env.reset(SEED)
    runner = EpisodeRunner(env, policy, seed=SEED)
    for k in range(n_steps):
        drag = DragTarget(node=1 + k // 6, target_m=[0.1 * k, 0.0, 0.2]) if k in (2, 3, 4, 6, 7) else None
        if k == 5:
            runner.disturb("wind")
        assert runner.step("place", drag, intervention=k == 9) is None
    hands = np.zeros(env.spec.robot.hand_shape)
    policy.act = lambda seen: Decision(action=np.ones(env.spec.robot.size), hand=hands)
    for _ in range(3):
        assert runner.step("place") is None
    return runner.build_episode("interrupted", "partial")


def test_what_a_person_does_is_recorded_step_by_step(env):
    episode = driven(env)
    assert [s.drag and s.drag.node for s in episode.steps[:9]] == [None, None, 1, 1, 1, None, 2, 2, None]
    assert [k for k, step in enumerate(episode.steps) if step.intervention] == [9]
    assert not episode.steps[9].force_n.any()
    assert episode.steps[3].force_n.any()
    guided = episode.steps[-1]
    assert guided.hand_m.tolist() == [0, 0, 0]
    # The recorded action is what the robot did, not what the decision says.
    moved = episode.final_observation.holder_position - guided.observation.holder_position
    np.testing.assert_allclose(guided.action, moved[[0, 2]], atol=1e-15)


def disturbed_in_the_middle(env):
    return run(env, at("step", 5), disturbance="gust")


def disturbed_twice(env):
    return run(env, scheduled(repeats=2), disturbance="thesis")


CASES = [*product([disturbed_in_the_middle, disturbed_twice], [None, 8]), (driven, None)]


@pytest.mark.parametrize(("make", "diverges_at"), CASES)
def test_an_episode_runs_again_to_the_bit_from_its_file(make, diverges_at, tmp_path, differences):
    saved = through_a_file(make(make_env(diverges_at=diverges_at)), tmp_path / "s.h5")
    again = replay_actions(make_env(diverges_at=diverges_at), saved)
    assert compare(saved, again).identical
    assert differences(again.disturbances, saved.disturbances) == []
    for before, after in zip(saved.steps, again.steps, strict=True):
        assert differences(replace(after, action_std=before.action_std), before) == []


def test_a_replay_follows_the_recorded_plan_not_the_name(tmp_path):
    saved = through_a_file(disturbed_twice(make_env()), tmp_path / "s.h5")
    first, second = saved.disturbances
    renamed = replace(saved, disturbances=[replace(first, name="gone"), replace(second, name="gone")])
    assert compare(saved, replay_actions(make_env(), renamed)).identical
    swapped = replace(saved, disturbances=[replace(first, plan=second.plan), second])
    divergence = compare(saved, replay_actions(make_env(), swapped))
    assert divergence.first_step == first.first_step + 1


def test_a_journal_has_disturbances_as_they_come(env, tmp_path):
    path = tmp_path / "s.h5"
    with SessionRecorder(path, robot=env.spec.robot, cloth="towel") as recorder:
        runner = EpisodeRunner(env, ForwardPolicy(), seed=SEED, disturbance="gust", on_start=recorder.start)
        runner.step("place")
        runner.disturb("wind")
        runner.step("place")
        runner.step("place")
        (journal,) = journals(parts_folder(path))
        recorder._running[0].close()
        left = read_journal(journal).episode
        # The last step is not known to its end.
        assert (len(left.steps), left.disturbance) == (2, "gust")
        (record,) = left.disturbances
        assert (record.name, record.first_step, record.last_step) == ("wind", 1, None)
        assert record.plan == runner.disturbances[0].plan
        recorder._running[0].discard()
