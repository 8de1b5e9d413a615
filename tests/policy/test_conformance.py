"""What every policy keeps, whatever it decides by; a new one in the registry inherits this."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from layflat.data.types import ACTION_LIMIT_M, STOP_REASONS, GroundTruth, Observation
from layflat.policy import registry
from layflat.policy.base import Policy, continue_after_disturbance
from layflat.policy.model_policy import ModelPolicy
from layflat.policy.scripted.demonstrator import ScriptedDemonstrator
from layflat.policy.scripted.replay import ReplayPolicy
from layflat.policy.scripted.wrinkle_removal import CONTROLLERS, controller
from layflat.policy.wrappers.sequential import SequentialPolicy
from layflat.policy.wrappers.takeover import TakeoverPolicy
from layflat.tests.factories import PICKERS, ROBOT_SPECS

HANDOVER = "handover"
TAKEOVER = "takeover"
EXPERT = "scripted"
RECORDED = "recorded"
FLATTEN = "flatten-"
AROUND = "hold+"
"""What can be put around any policy, around one of the poorest."""
OTHERS = (HANDOVER, TAKEOVER, EXPERT, RECORDED, *(AROUND + name for name in registry.WRAPPERS))
PLACERS = [
    (name, robot)
    for name in (*registry.BUILTIN_POLICIES, *registry.TRAINABLE_POLICIES, *OTHERS)
    for robot in ROBOT_SPECS
]


@pytest.fixture(
    params=[*PLACERS, *((FLATTEN + name, PICKERS) for name in CONTROLLERS)], ids=lambda param: f"{param[0]}-{param[1]}"
)
def policy(request, model_of, learned_of, make_episode) -> Policy:
    name, robot = request.param
    if name == RECORDED:
        return ReplayPolicy(make_episode(robot, n_steps=50))
    if name.startswith(FLATTEN):
        return controller(name.removeprefix(FLATTEN), robot)
    if name.startswith(AROUND):
        return registry.wrap(registry.make("hold", robot), [name.removeprefix(AROUND)])
    if name == HANDOVER:
        first = ModelPolicy(model_of(robot, "position"))
        return SequentialPolicy(first, registry.make("drag-rule", robot), name="gp-baseline+drag-rule")
    if name == TAKEOVER:
        return TakeoverPolicy(ModelPolicy(model_of(robot, "position")), registry.make("random", robot), lambda: "take")
    if name == EXPERT:
        # A cloth that lies at x = 0 whatever is done to it.
        ground_truth = GroundTruth(nodes=np.zeros((9, 3)), contact_portion_true=1.0, flat_area=1.0)
        return ScriptedDemonstrator(
            robot, length_m=0.35, columns=3, held_width_m=0.36, ground_truth=lambda: ground_truth
        )
    if name in registry.TRAINABLE_POLICIES:
        return registry.from_model(learned_of(name, robot))
    return registry.make(name, robot)


def placing(observe: Callable[..., Observation], n_steps: int = 40) -> list[Observation]:
    """From the air to the table, contact growing to 0.9 and staying there."""
    share = np.linspace(0, 1, n_steps)
    return [
        observe(0.4 * s, 0.4 * (1 - s), contact=min(1.2 * s, 0.9), word=(np.cos(s), np.sin(s)), time_s=0.1 * k)
        for k, s in enumerate(share)
    ]


def run(policy: Policy, observations: list[Observation], seed: int) -> list:
    policy.reset(seed)
    return [policy.act(observation) for observation in observations]


def test_is_a_policy_with_a_name_and_a_robot(policy):
    assert isinstance(policy, Policy)
    assert policy.name
    assert policy.robot in ROBOT_SPECS


def test_decisions_are_well_formed(policy, observe):
    for decision in run(policy, placing(observe), seed=1):
        assert decision.action.shape == (policy.robot.size,)
        assert np.abs(decision.action).max() <= ACTION_LIMIT_M
        assert decision.stop is None or decision.stop in STOP_REASONS
        assert decision.reason
        if decision.std is not None:
            assert (decision.std > 0).all()


def test_a_stop_moves_nothing(policy, observe):
    stops = [d for d in run(policy, placing(observe) + 40 * [observe(0.4, 0.0, contact=0.9)], seed=1) if d.stop]
    assert all(not decision.action.any() for decision in stops)


def test_same_seed_same_decisions_also_after_another_episode(policy, observe):
    observations = placing(observe)
    first = run(policy, observations, seed=5)
    run(policy, observations[::-1], seed=6)
    again = run(policy, observations, seed=5)
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a.action, b.action)
        assert (a.stop, a.reason) == (b.stop, b.reason)


def test_resume_goes_on_where_a_new_episode_would_begin(policy, observe):
    """After resume a stop needs as many steps as after reset: nothing of the old counters is left."""
    if isinstance(policy, SequentialPolicy):
        pytest.skip("goes on as another policy, see test_handover")
    policy.reset(0)
    fresh = [policy.act(observe(0.3, 0.01, contact=0.85)).stop for _ in range(12)]
    continue_after_disturbance(policy)
    resumed = [policy.act(observe(0.3, 0.01, contact=0.85)).stop for _ in range(12)]
    assert fresh == resumed
