from __future__ import annotations

import numpy as np
import pytest

from layflat.policy import registry
from layflat.policy.scripted.baselines import RandomPolicy, drag_rule, stretch_right
from layflat.policy.scripted.replay import ReplayPolicy
from layflat.tests.factories import HANGER, PICKERS
from layflat.tests.policy.factories import episode_of, observe


def test_hold_never_moves():
    policy = registry.make("hold", PICKERS)
    assert not any(policy.act(observe(contact=c)).action.any() for c in (0.0, 0.5, 1.0))


def test_stretch_right_ignores_the_cloth_and_ends_with_the_view():
    policy = stretch_right(HANGER)
    policy.reset(0)
    actions = [policy.act(observe(0.3, contact=c)).action for c in (0.0, 1.0, 0.4)]
    assert all(np.array_equal(action, actions[0]) and action[0] > 0 for action in actions)
    assert policy.act(observe(5.0)).stop is not None


def test_drag_rule_continues_while_contact_grows_and_stops_when_it_does_not():
    policy = drag_rule(HANGER)
    policy.reset(0)
    growing = [policy.act(observe(0.3, contact=0.5 + 0.01 * k)) for k in range(40)]
    assert all(decision.stop is None for decision in growing)
    assert [policy.act(observe(0.3, contact=0.9)) for _ in range(10)][-1].stop == "converged"


def test_drag_rule_leaves_a_flat_cloth_alone():
    policy = drag_rule(HANGER)
    policy.reset(0)
    decision = policy.act(observe(0.3, contact=1.0))
    assert decision.stop == "converged"
    assert not decision.action.any()


def test_random_moves_fill_their_range_and_differ_by_seed():
    policy = RandomPolicy(PICKERS, limit_m=0.01)
    draws = []
    for seed in (1, 2):
        policy.reset(seed)
        draws.append(np.array([policy.act(observe()).action for _ in range(300)]))
    assert not np.array_equal(*draws)
    assert np.abs(draws).max() <= 0.01
    assert np.abs(np.mean(draws)) < 1e-3
    assert np.std(draws) == pytest.approx(0.01 / np.sqrt(3), rel=0.05)


def test_actions_come_in_order_without_those_of_the_disturbance():
    actions = np.random.default_rng(0).uniform(-0.01, 0.01, (5, 2))
    phases = ["place", "place", "disturb", "disturb", "repair"]
    policy = ReplayPolicy(episode_of(5 * [observe()], actions, phases=phases))
    for _ in range(2):
        policy.reset(0)
        decisions = [policy.act(observe()) for _ in range(5)]
        assert [decision.stop is None for decision in decisions] == [True, True, True, False, False]
        np.testing.assert_array_equal([decision.action for decision in decisions[:3]], actions[[0, 1, 4]])
        assert not decisions[3].action.any()
