"""Properties of every policy; a new one in the registry inherits these tests."""

from __future__ import annotations

from functools import partial
from itertools import product

import numpy as np
import pytest

from layflat.data.robot import RobotSpec
from layflat.data.types import ACTION_LIMIT_M, STOP_REASONS, GroundTruth, Observation
from layflat.policy import registry
from layflat.policy.base import Decision, Policy, continue_after_disturbance, max_extra_steps
from layflat.policy.model_policy import ModelPolicy
from layflat.policy.scripted.demonstrator import ScriptedDemonstrator
from layflat.policy.scripted.replay import ReplayPolicy
from layflat.policy.scripted.wrinkle_removal import CONTROLLERS, controller
from layflat.policy.wrappers.sequential import SequentialPolicy
from layflat.policy.wrappers.takeover import TakeoverPolicy
from layflat.tests.factories import HANGER, PICKERS, ROBOT_SPECS
from layflat.tests.policy.factories import demonstrations, gp_model, observe, trained_model


def demonstrator(robot: RobotSpec) -> Policy:
    # A cloth that lies at x = 0 all the time.
    truth = GroundTruth(nodes=np.zeros((9, 3)), contact_portion_true=1.0, flat_area=1.0)
    return ScriptedDemonstrator(robot, length_m=0.35, columns=3, held_width_m=0.36, ground_truth=lambda: truth)


def baseline(robot: RobotSpec) -> Policy:
    return ModelPolicy(gp_model(robot, "position", policy="gp-baseline"))


def learned(name: str, robot: RobotSpec) -> Policy:
    return registry.from_model(trained_model(name, robot))


def wrapped(name: str, robot: RobotSpec) -> Policy:
    return registry.wrap(registry.make("hold", robot), [name])


MAKERS = {
    **{name: partial(registry.make, name) for name in registry.BUILTIN_POLICIES},
    **{name: partial(learned, name) for name in registry.TRAINABLE_POLICIES},
    **{f"hold+{name}": partial(wrapped, name) for name in registry.WRAPPERS},
    "scripted": demonstrator,
    "replay": lambda robot: ReplayPolicy(demonstrations(robot)[0]),
    "sequential": lambda robot: SequentialPolicy(baseline(robot), registry.make("drag-rule", robot), name="two"),
    "takeover": lambda robot: TakeoverPolicy(baseline(robot), registry.make("random", robot), lambda: "take"),
}
CASES = [*product(MAKERS, ROBOT_SPECS), *((name, PICKERS) for name in CONTROLLERS if name not in MAKERS)]


@pytest.fixture(params=CASES, ids=lambda case: f"{case[0]}-{case[1]}")
def policy(request) -> Policy:
    name, robot = request.param
    return MAKERS[name](robot) if name in MAKERS else controller(name, robot)


def placing(n_steps: int = 40) -> list[Observation]:
    """From the air to the table, contact growing to 0.9 and staying there."""
    return [
        observe(0.4 * s, 0.4 * (1 - s), contact=min(1.2 * s, 0.9), word=(np.cos(s), np.sin(s)), time_s=0.1 * k)
        for k, s in enumerate(np.linspace(0, 1, n_steps))
    ]


def run(policy: Policy, observations: list[Observation], seed: int) -> list[Decision]:
    policy.reset(seed)
    return [policy.act(observation) for observation in observations]


def test_is_a_policy_with_a_name_and_a_robot(policy):
    assert isinstance(policy, Policy)
    assert policy.name
    assert policy.robot in ROBOT_SPECS
    assert max_extra_steps(policy) >= 0


def test_decisions_are_well_formed_and_a_stop_moves_nothing(policy):
    for decision in run(policy, placing() + 40 * [observe(0.4, 0.0, contact=0.9)], seed=1):
        assert decision.action.shape == (policy.robot.size,)
        assert np.abs(decision.action).max() <= ACTION_LIMIT_M
        assert decision.stop is None or decision.stop in STOP_REASONS
        assert decision.stop is None or not decision.action.any()
        assert decision.reason
        assert decision.std is None or (decision.std > 0).all()


def test_same_seed_same_decisions_also_after_another_episode(policy):
    first = run(policy, placing(), seed=5)
    run(policy, placing()[::-1], seed=6)
    for a, b in zip(first, run(policy, placing(), seed=5), strict=True):
        np.testing.assert_array_equal(a.action, b.action)
        assert (a.stop, a.reason) == (b.stop, b.reason)


def test_after_a_disturbance_a_stop_needs_as_many_steps_as_after_a_reset(policy):
    if isinstance(policy, SequentialPolicy):
        pytest.skip("continues as another policy, see test_sequential")
    policy.reset(0)
    fresh = [policy.act(observe(0.3, 0.01, contact=0.85)).stop for _ in range(12)]
    continue_after_disturbance(policy)
    assert [policy.act(observe(0.3, 0.01, contact=0.85)).stop for _ in range(12)] == fresh


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


@pytest.mark.parametrize("name", registry.TRAINABLE_POLICIES)
def test_each_policy_sees_the_position_and_what_it_is_named_after(name):
    extra = {
        "gp-baseline": set(),
        "dmp": set(),
        "gp-contact": {"contact"},
        "gp-direction": {"word_x", "word_y"},
    }.get(name, {"contact", "word_x", "word_y"})
    model = registry.train(name, demonstrations(HANGER))
    assert set(model.layout.names) - {"x", "z"} == extra
    assert model.policy == name
