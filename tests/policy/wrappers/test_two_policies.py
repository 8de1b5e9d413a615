"""The policy acts until a person takes control, and again after the release; only the person's steps are marked."""

from __future__ import annotations

import numpy as np

from layflat.policy import registry
from layflat.policy.base import Decision, continue_after_disturbance
from layflat.policy.wrappers.sequential import SequentialPolicy
from layflat.policy.wrappers.takeover import MotionTakeoverTrigger, TakeoverPolicy
from layflat.tests.factories import HANGER, PICKERS
from layflat.tests.policy.factories import observe


class Counter:
    """Moves by the number of steps that it has decided since it started or continued; stops after ``most``."""

    robot = HANGER

    def __init__(self, name: str, step_m: float, most: int = 100) -> None:
        self.name, self._step_m, self._most, self.count = name, step_m, most, 0

    def reset(self, seed: int) -> None:
        self.count = 0

    def continue_after_disturbance(self) -> None:
        self.count = 0

    def act(self, observation) -> Decision:
        self.count += 1
        return Decision(action=[self._step_m * self.count, 0.0], stop="threshold" if self.count > self._most else None)


def run(requests, most=100) -> tuple[TakeoverPolicy, list[Decision]]:
    """Return the policy and its decisions while the person makes these requests."""
    wanted = iter([*requests, None, None])
    policy = TakeoverPolicy(Counter("gp-word", 0.001, most), Counter("gamepad", -0.001), lambda: next(wanted))
    policy.reset(0)
    return policy, [policy.act(observe(0.3, 0.01)) for _ in requests]


def test_the_person_is_in_control_from_the_request_until_the_release():
    policy, decisions = run([None, None, "take", None, "take", "release", None])
    assert [round(1000 * float(d.action[0])) for d in decisions] == [1, 2, -1, -2, -3, 1, 2]
    assert [d.intervention for d in decisions] == [False, False, True, True, True, False, False]
    assert policy.name == "gp-word+gamepad"


def test_a_release_without_control_changes_nothing():
    _, decisions = run([None, "release", None])
    assert [round(1000 * float(d.action[0])) for d in decisions] == [1, 2, 3]
    assert not any(d.intervention for d in decisions)


def test_the_policys_stop_rules_restart_after_a_correction():
    """Without help it would stop in its third step."""
    assert [d.stop for d in run([None] * 3, most=2)[1]] == [None, None, "threshold"]
    assert [d.stop for d in run([None, None, "take", "release", None, None], most=2)[1]] == [None] * 5 + ["threshold"]


def test_reset_ends_the_control_and_a_disturbance_does_not():
    policy, _ = run(["take"])
    continue_after_disturbance(policy)
    assert policy.human_in_control
    assert policy.act(observe(0.3, 0.01)).intervention
    policy.reset(1)
    assert not policy.human_in_control
    assert not policy.act(observe(0.3, 0.01)).intervention


def test_the_persons_decision_changes_only_by_its_mark():
    person = registry.make("random", PICKERS)
    policy = TakeoverPolicy(registry.make("hold", PICKERS), person, lambda: "take")
    policy.reset(5)
    mine = policy.act(observe(0.3, 0.01))
    person.reset(5)
    np.testing.assert_array_equal(mine.action, person.act(observe(0.3, 0.01)).action)


def test_motion_keeps_control_until_the_hands_have_rested():
    moving = iter([False, True, False, False, True, False, False, False, False])
    trigger = MotionTakeoverTrigger(lambda: next(moving), rest_steps=3)
    requests = [trigger() for _ in range(9)]
    assert requests == [None, "take", None, None, "take", None, None, "release", "release"]


def test_a_release_by_hand_does_not_wait():
    trigger = MotionTakeoverTrigger(iter([True, False, True]).__next__, rest_steps=3)
    assert trigger() == "take"
    trigger.release()
    assert [trigger(), trigger()] == ["release", "take"]


def test_the_second_acts_only_after_the_disturbance_and_a_reset_returns_to_the_first():
    first, then = registry.make("hold", HANGER), registry.make("stretch-right", HANGER)
    policy = SequentialPolicy(first, then, name="hold+stretch-right")
    for seed in (0, 1):
        policy.reset(seed)
        np.testing.assert_array_equal(policy.act(observe(0.3, 0.01)).action, np.zeros(2))
        continue_after_disturbance(policy)
        assert policy.act(observe(0.3, 0.01)).action[0] > 0
