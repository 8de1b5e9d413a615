"""The first policy places, the second repairs."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.policy import registry
from layflat.policy.base import PolicyError, continue_after_disturbance
from layflat.policy.wrappers.sequential import SequentialPolicy
from layflat.tests.factories import HANGER, PICKERS


@pytest.fixture
def handover():
    first, then = registry.make("hold", HANGER), registry.make("stretch-right", HANGER)
    policy = SequentialPolicy(first, then, name="hold+stretch-right")
    policy.reset(0)
    return policy


def test_the_second_acts_only_after_resume(handover, observe):
    assert not handover.act(observe(0.3, 0.01)).action.any()
    continue_after_disturbance(handover)
    assert handover.act(observe(0.3, 0.01)).action[0] > 0


def test_reset_hands_back_to_the_first(handover, observe):
    continue_after_disturbance(handover)
    handover.reset(1)
    np.testing.assert_array_equal(handover.act(observe(0.3, 0.01)).action, np.zeros(2))


def test_policies_of_different_robots_are_refused():
    with pytest.raises(PolicyError, match="pickers"):
        SequentialPolicy(registry.make("hold", HANGER), registry.make("hold", PICKERS), name="both")
