from __future__ import annotations

from dataclasses import replace

import numpy as np

from layflat.policy.base import continue_after_disturbance
from layflat.policy.model_policy import ModelPolicy
from layflat.policy.stopping import AnyOf
from layflat.tests.policy.factories import gp_model, observe


def test_an_output_below_the_threshold_moves_nothing():
    """Chapter 4-3-3: the robot stands still, so what is regained after a stop was commanded, not crept."""
    policy = ModelPolicy(replace(gp_model(), stop_threshold_m=1.0, stop_steps=50))
    assert all(not policy.act(observe(0.1, 0.1, contact=c)).action.any() for c in (0.2, 0.6, 1.0))
    keen = ModelPolicy(replace(gp_model(), stop_threshold_m=1e-9))
    assert keen.act(observe(0.1, 0.1, contact=0.5)).action.any()


def test_output_is_clipped_to_the_action_limit():
    model = gp_model()
    wild = replace(model, alpha=1e4 * model.alpha)
    policy = ModelPolicy(wild, guard=AnyOf())
    raw, _ = wild.predict([wild.layout.vector(observe())])
    assert np.abs(raw).max() > wild.action_limit_m
    np.testing.assert_allclose(policy.act(observe()).action, np.clip(raw[0], -wild.action_limit_m, wild.action_limit_m))


def test_stops_by_threshold_far_from_the_data_and_again_after_a_disturbance():
    model = gp_model()
    policy = ModelPolicy(model, guard=AnyOf())
    policy.reset(0)
    lost = observe(-30.0, 30.0)
    for _ in range(2):
        stops = [policy.act(lost).stop for _ in range(model.stop_steps)]
        assert stops == [None] * (model.stop_steps - 1) + ["threshold"]
        continue_after_disturbance(policy)


def test_guard_ends_a_drag_that_gains_nothing():
    eager = replace(gp_model(inputs="position"), stop_threshold_m=1e-12)
    assert ModelPolicy(eager).act(observe(0.8, contact=0.9)).stop == "step_limit"
    policy = ModelPolicy(eager)
    assert "converged" in [policy.act(observe(0.3, contact=0.9)).stop for _ in range(15)]
