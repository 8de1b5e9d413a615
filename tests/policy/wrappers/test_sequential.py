"""The first policy places, the second repairs."""

from __future__ import annotations

import numpy as np

from layflat.policy import registry
from layflat.policy.base import continue_after_disturbance
from layflat.policy.wrappers.sequential import SequentialPolicy
from layflat.tests.factories import HANGER
from layflat.tests.policy.factories import observe


def test_the_second_acts_only_after_the_disturbance_and_a_reset_returns_to_the_first():
    first, then = registry.make("hold", HANGER), registry.make("stretch-right", HANGER)
    policy = SequentialPolicy(first, then, name="hold+stretch-right")
    for seed in (0, 1):
        policy.reset(seed)
        np.testing.assert_array_equal(policy.act(observe(0.3, 0.01)).action, np.zeros(2))
        continue_after_disturbance(policy)
        assert policy.act(observe(0.3, 0.01)).action[0] > 0
