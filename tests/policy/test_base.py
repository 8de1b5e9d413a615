from __future__ import annotations

import numpy as np
import pytest

from layflat.policy import registry
from layflat.policy.base import Decision, Policy, continue_after_disturbance, max_extra_steps
from layflat.tests.factories import HANGER
from layflat.tests.policy.factories import observe


class OwnPolicy:
    """The least that a user's own policy needs."""

    name = "own"
    robot = HANGER

    def reset(self, seed: int) -> None:
        self.seed = seed

    def act(self, observation):
        return Decision(action=[0.001, 0.0])


def test_a_policy_without_the_optional_members_can_be_wrapped_and_continued():
    policy = OwnPolicy()
    assert isinstance(policy, Policy)
    assert max_extra_steps(policy) == 0
    wrapped = registry.wrap(policy, registry.RECOMMENDED_WRAPPERS)
    wrapped.reset(5)
    continue_after_disturbance(wrapped)
    np.testing.assert_array_equal(wrapped.act(observe()).action, [0.001, 0.0])
    assert policy.seed == 5
    assert wrapped.name == "own+recovery+steady"


def test_wrappers_add_up_the_steps_that_they_need():
    once = registry.wrap(OwnPolicy(), ["recovery"])
    both = registry.wrap(OwnPolicy(), registry.RECOMMENDED_WRAPPERS)
    assert 0 < max_extra_steps(once) < max_extra_steps(both)
    assert max_extra_steps(both) - max_extra_steps(once) == max_extra_steps(registry.wrap(OwnPolicy(), ["steady"]))


def test_a_decision_keeps_read_only_copies():
    action = np.zeros(2)
    decision = Decision(action=action, std=[0.1, 0.1], hand=[0.0, 0.0, 0.1])
    action[0] = 1.0
    assert not decision.action.any()
    for array in (decision.action, decision.std, decision.hand):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
