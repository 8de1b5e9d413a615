"""A recording as a policy: its actions in their order, and no others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from layflat.policy.scripted.replay import ReplayPolicy


def test_actions_come_in_order_without_those_of_the_disturbance(make_episode):
    phases = ["place", "place", "disturb", "disturb", "repair"]
    episode = make_episode(n_steps=5)
    steps = tuple(replace(step, phase=phase) for step, phase in zip(episode.steps, phases, strict=True))
    policy = ReplayPolicy(replace(episode, steps=steps))
    for _ in range(2):
        policy.reset(0)
        for step_index in (0, 1, 4):
            decision = policy.act(episode.final_observation)
            np.testing.assert_array_equal(decision.action, steps[step_index].action)
            assert decision.stop is None
        assert policy.act(episode.final_observation).stop is not None
        assert not policy.act(episode.final_observation).action.any()
