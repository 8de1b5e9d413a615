"""One episode step by step: what befalls the cloth is in it, with its steps, and it runs again to the bit."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest

from layflat.app.commands.replay import compare
from layflat.app.support.errors import UsageError
from layflat.data import SessionRecorder, open_session, validate
from layflat.data.session.journal_reader import read_journal
from layflat.data.session.parts import journals, parts_folder
from layflat.data.types import DragTarget
from layflat.policy.base import Decision
from layflat.policy.rollout import replay_actions, rollout, run_disturbances, run_until_stop
from layflat.policy.runner import EpisodeRunner
from layflat.policy.schedule import DisturbanceScheduler, ScheduledDisturbance, Trigger
from layflat.sim.config import SimConfig
from layflat.sim.disturbances.presets import DISTURBANCES, disturbance_spec
from layflat.tests.fake_environment import ACTING_STEPS, FakeEnvironment, ForwardPolicy

SEED = 3


@pytest.fixture
def make_bench():
    def made(robot="hanger"):
        bench = FakeEnvironment(SimConfig(robot=robot, cloth="towel"))
        bench.reset(SEED)
        return bench

    return made


@pytest.fixture
def bench(make_bench):
    return make_bench()


def _scheduled(name="thesis", **when):
    return ScheduledDisturbance(disturbance=DISTURBANCES[name], **when)


def _at(moment, value, name="wind", **more):
    return _scheduled(name, when=Trigger(kind=moment, value=value), **more)


def _through_a_file(episode, path):
    with SessionRecorder(path, robot=episode.robot, cloth=episode.cloth) as recorder:
        recorder.save(episode)
    assert validate(path) == ()
    with open_session(path) as session:
        return session[0]


# What befalls the cloth


def test_a_named_disturbance_comes_once_after_the_stop(bench):
    policy = ForwardPolicy()
    episode = rollout(bench, policy, seed=SEED, disturbance="thesis")
    (befell,) = episode.disturbances
    first, end = episode.phase_bounds("disturb")
    assert (befell.name, befell.first_step, befell.last_step) == ("thesis", first, end - 1)
    assert end - first == ACTING_STEPS
    assert (
        befell.plan
        == disturbance_spec("thesis").sample(np.random.default_rng([SEED, 0]), bench.config.cloth_spec).described()
    )
    assert policy.resumed == 1
    assert [step.phase for step in episode.steps] == sorted(
        (s.phase for s in episode.steps), key=("place", "disturb", "repair").index
    )
    assert (episode.stopped_by, episode.disturbance) == ("converged", "thesis")
    acting = [bool(step.force_n.any()) for step in episode.steps]
    assert acting == [step.phase == "disturb" for step in episode.steps]


def test_repeats_come_one_after_another_each_with_its_chance(bench):
    episode = rollout(bench, ForwardPolicy(), seed=SEED, disturbance="thesis", schedule=[_scheduled(repeats=3)])
    told = [step.phase for step in episode.steps]
    changes = [a for a, b in zip(told, ["", *told], strict=False) if a != b]
    assert changes == ["place", *["disturb", "repair"] * 3]
    assert len({str(record.plan) for record in episode.disturbances}) == 3
    for record in episode.disturbances:
        assert told[record.first_step : record.last_step + 1] == ["disturb"] * ACTING_STEPS


def test_one_at_a_step_acts_while_the_policy_goes_on(bench):
    episode = rollout(bench, ForwardPolicy(), seed=SEED, disturbance="gust", schedule=[_at("step", 5)])
    (befell,) = episode.disturbances
    assert (befell.name, befell.first_step, befell.last_step) == ("wind", 5, 4 + ACTING_STEPS)
    assert {step.phase for step in episode.steps} == {"place"}
    assert all(step.action.any() for step in episode.steps)
    assert episode.disturbance == "gust"


def test_one_at_a_contact_begins_when_the_camera_first_sees_it(bench):
    episode = rollout(bench, ForwardPolicy(), seed=SEED, schedule=[_at("contact", 0.25)])
    (befell,) = episode.disturbances
    assert episode.disturbance == "wind"
    contact = episode.contact()
    assert contact[befell.first_step] >= 0.25
    assert contact[: befell.first_step].max() < 0.25


def test_one_that_still_acts_when_the_policy_stops_is_waited_for(bench):
    policy, acts = ForwardPolicy(), iter([*[None] * 10, "threshold", *[None] * 3, "converged"])
    policy.act = lambda seen: Decision(action=[0.01, 0.0], stop=next(acts))
    episode = rollout(bench, policy, seed=SEED, schedule=[_at("step", 9)])
    (befell,) = episode.disturbances
    told = [step.phase for step in episode.steps]
    assert told == ["place"] * 10 + ["disturb"] * (ACTING_STEPS - 1) + ["repair"] * 3
    assert (befell.first_step, befell.last_step) == (9, 8 + ACTING_STEPS)
    assert (episode.stopped_by, policy.resumed) == ("converged", 1)


def test_what_falls_due_together_comes_one_after_another(bench):
    episode = rollout(
        bench, ForwardPolicy(), seed=SEED, schedule=[_at("step", 5), _at("step", 5, "push"), _scheduled("poke")]
    )
    told = [(record.name, record.first_step) for record in episode.disturbances]
    assert told[:2] == [("wind", 5), ("push", 5 + ACTING_STEPS)]
    assert told[2][0] == "poke"
    assert told[2][1] == episode.phase_bounds("disturb")[0]


def test_a_step_that_was_not_reached_comes_after_the_stop_and_a_contact_never(bench):
    episode = rollout(bench, ForwardPolicy(), seed=SEED, schedule=[_at("contact", 0.9), _at("step", 900, repeats=2)])
    assert [record.name for record in episode.disturbances] == ["wind", "wind"]
    assert episode.phase_bounds("place")[1] == episode.disturbances[0].first_step


def test_chance_is_the_schedules_whatever_comes_first(make_bench):
    """Two policies that reach the same moments in another order meet the same disturbances."""
    schedule = [_at("contact", 0.3), _at("step", 8, "push"), _scheduled("poke", repeats=2)]
    slow, quick = ForwardPolicy(), ForwardPolicy()
    quick.act = lambda seen: replace(ForwardPolicy.act(quick, seen), action=np.array([0.02, 0.0]))
    plans, orders = [], []
    for policy in (slow, quick):
        befell = rollout(make_bench(), policy, seed=SEED, schedule=schedule).disturbances
        orders.append([record.name for record in befell])
        plans.append(sorted((record.name, str(record.plan)) for record in befell))
    assert orders[0] != orders[1]
    assert plans[0] == plans[1]


def test_copies_of_a_placing_go_on_as_an_episode_that_was_never_copied(make_bench):
    run = EpisodeRunner(make_bench(), ForwardPolicy(), seed=SEED)
    stopped_by = run_until_stop(run)
    for name in ("none", "push", "wind"):
        twin = copy.deepcopy(run)
        twin.disturbance = name
        schedule = [] if name == "none" else [_scheduled(name)]
        episode = twin.episode(run_disturbances(twin, DisturbanceScheduler(schedule), stopped_by))
        whole = rollout(make_bench(), ForwardPolicy(), seed=SEED, disturbance=name)
        assert compare(whole, episode).identical
        assert (episode.disturbance, episode.disturbances) == (name, whole.disturbances)


def test_an_unstable_cloth_ends_the_episode_and_its_disturbance_was_never_over(bench):
    bench.diverges_at = 7
    episode = rollout(bench, ForwardPolicy(), seed=SEED, schedule=[_at("step", 5), _scheduled()])
    (befell,) = episode.disturbances
    assert (episode.stopped_by, episode.outcome, len(episode.steps)) == ("unstable", "failure", 7)
    assert (befell.first_step, befell.last_step) == (5, None)


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (lambda: Trigger(kind="step", value=2.5), "step 2.5"),
        (lambda: Trigger(kind="step", value=-1), "step -1"),
        (lambda: Trigger(kind="contact", value=1.5), "contact 1.5"),
        (lambda: _scheduled(repeats=0), "0 times"),
    ],
)
def test_a_schedule_that_makes_no_sense_is_one_sentence(wrong, sentence):
    with pytest.raises(UsageError, match=sentence):
        wrong()


# A person's hand


def _driven(bench, n_steps=12):
    """By a person: pulls for three steps, lets go, pulls elsewhere, disturbs; the hand leads the holder at the end."""
    policy = ForwardPolicy()
    run = EpisodeRunner(bench, policy, seed=SEED)
    for step_index in range(n_steps):
        pull = (
            DragTarget(node=1 + step_index // 6, target_m=[0.1 * step_index, 0.0, 0.2])
            if step_index in (2, 3, 4, 6, 7)
            else None
        )
        if step_index == 5:
            run.disturb("wind")
        assert run.step("place", pull, intervention=step_index == 9) is None
    hands = np.zeros(3) if bench.spec.robot.n_points == 1 else np.zeros((2, 3))
    policy.act = lambda seen: Decision(action=np.ones(run.steps[0].action.size), hand=hands)
    for _ in range(3):
        assert run.step("place") is None
    return run.episode("interrupted", "partial")


def test_what_a_person_does_is_recorded_step_by_step(bench):
    episode = _driven(bench)
    assert [s.drag and s.drag.node for s in episode.steps[:9]] == [None, None, 1, 1, 1, None, 2, 2, None]
    assert [i for i, step in enumerate(episode.steps) if step.intervention] == [9]
    assert not episode.steps[8 + 1].force_n.any()
    assert episode.steps[3].force_n.any()
    guided = episode.steps[-1]
    assert guided.hand_m.tolist() == [0, 0, 0]
    # What the holder really did, not what the decision says.
    moved = episode.final_observation.holder_position - guided.observation.holder_position
    np.testing.assert_allclose(guided.action, moved[[0, 2]], atol=1e-15)


def _disturbed_in_the_middle(bench):
    return rollout(bench, ForwardPolicy(), seed=SEED, disturbance="gust", schedule=[_at("step", 5)])


def _disturbed_twice(bench):
    return rollout(bench, ForwardPolicy(), seed=SEED, disturbance="thesis", schedule=[_scheduled(repeats=2)])


def _diverged(bench):
    bench.diverges_at = 8
    return rollout(bench, ForwardPolicy(), seed=SEED, schedule=[_at("step", 5)])


@pytest.mark.parametrize("made", [_driven, _disturbed_in_the_middle, _disturbed_twice, _diverged])
def test_an_episode_runs_again_to_the_bit_from_its_file(made, make_bench, tmp_path, differences):
    kept = _through_a_file(made(make_bench()), tmp_path / "s.h5")
    bench = make_bench()
    bench.diverges_at = 8 if made is _diverged else None
    again = replay_actions(bench, kept)
    assert compare(kept, again).identical
    assert differences(again.disturbances, kept.disturbances) == []
    for before, after in zip(kept.steps, again.steps, strict=True):
        assert differences(replace(after, action_std=before.action_std), before) == []


def test_the_plan_counts_not_its_name(make_bench, tmp_path):
    kept = _through_a_file(_disturbed_twice(make_bench()), tmp_path / "s.h5")
    first, second = kept.disturbances
    renamed = replace(kept, disturbances=[replace(first, name="gone"), replace(second, name="gone")])
    assert compare(kept, replay_actions(make_bench(), renamed)).identical
    swapped = replace(kept, disturbances=[replace(first, plan=second.plan), second])
    divergence = compare(kept, replay_actions(make_bench(), swapped))
    assert divergence.first_step == first.first_step + 1


def test_a_journal_hears_of_disturbances_as_they_come(bench, tmp_path):
    path = tmp_path / "s.h5"
    with SessionRecorder(path, robot="hanger", cloth="towel") as recorder:
        run = EpisodeRunner(bench, ForwardPolicy(), seed=SEED, disturbance="gust", begin=recorder.begin)
        run.step("place")
        run.disturb("wind")
        run.step("place")
        run.step("place")
        (journal,) = journals(parts_folder(path))
        recorder._running[0].close()
        left = read_journal(journal).episode
        # The last step is not known to its end.
        assert (len(left.steps), left.disturbance) == (2, "gust")
        (befell,) = left.disturbances
        assert (befell.name, befell.first_step, befell.last_step) == ("wind", 1, None)
        assert befell.plan == run.disturbances[0].plan
        recorder._running[0].discard()


def test_one_that_is_replaced_before_it_acts_was_never_there(bench):
    run = EpisodeRunner(bench, ForwardPolicy(), seed=SEED)
    run.step("place")
    run.disturb("wind")
    run.disturb("push")
    run.step("place")
    run.disturb("poke")
    run.step("place")
    told = [(record.name, record.first_step, record.last_step) for record in run.disturbances]
    assert told == [("push", 1, 1), ("poke", 2, None)]
