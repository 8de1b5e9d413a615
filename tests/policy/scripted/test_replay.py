"""A recording as a policy: its actions in their order, and no others."""

from __future__ import annotations

import numpy as np

from layflat.policy.scripted.replay import ReplayPolicy
from layflat.tests.policy.factories import episode_of, observe


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
