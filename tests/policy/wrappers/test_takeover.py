"""The policy acts until a person wants the lead, and again when it is handed back; only the person's are marked."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.policy import registry
from layflat.policy.base import Decision, PolicyError, continue_after_disturbance
from layflat.policy.wrappers.takeover import MotionTakeoverTrigger, TakeoverPolicy
from layflat.tests.factories import HANGER, PICKERS


class Counts:
    """Moves by the number of steps that it has decided since it last began or went on; stops at ``most``."""

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


def _run(wishes, observe, most=100):
    """What is decided while the person wants this; x in mm, and whether a person decided."""
    wanted = iter(wishes)
    policy = TakeoverPolicy(Counts("gp-word", 0.001, most), Counts("gamepad", -0.001), lambda: next(wanted))
    policy.reset(0)
    decided = [policy.act(observe(0.3, 0.01)) for _ in wishes]
    return policy, [round(1000 * float(d.action[0])) for d in decided], [d.intervention for d in decided], decided


def test_the_person_leads_from_their_wish_until_they_hand_back(observe):
    policy, moved, marked, _ = _run([None, None, "take", None, "take", "release", None], observe)
    assert moved == [1, 2, -1, -2, -3, 1, 2]
    assert marked == [False, False, True, True, True, False, False]
    assert policy.name == "gp-word+gamepad"


def test_handing_back_what_one_does_not_have_changes_nothing(observe):
    _, moved, marked, _ = _run([None, "release", None], observe)
    assert moved == [1, 2, 3]
    assert not any(marked)


def test_the_policy_counts_anew_after_a_correction(observe):
    """It would stop in its third step."""
    _, _, _, alone = _run([None] * 3, observe, most=2)
    assert [d.stop for d in alone] == [None, None, "threshold"]
    _, _, _, helped = _run([None, None, "take", "release", None, None], observe, most=2)
    assert [d.stop for d in helped] == [None, None, None, None, None, "threshold"]


def test_reset_takes_the_lead_away_and_resume_leaves_it(observe):
    policy, *_ = _run(["take"], observe)
    policy._request = lambda: None
    continue_after_disturbance(policy)
    assert policy.human_in_control
    policy.reset(1)
    assert not policy.act(observe(0.3, 0.01)).intervention


def test_what_the_person_decides_is_theirs_but_for_the_mark(observe):
    person = registry.make("random", PICKERS)
    policy = TakeoverPolicy(registry.make("hold", PICKERS), person, lambda: "take")
    policy.reset(5)
    mine = policy.act(observe(0.3, 0.01))
    person.reset(5)
    np.testing.assert_array_equal(mine.action, person.act(observe(0.3, 0.01)).action)


def test_a_grip_leads_while_the_hands_move_and_a_little_longer():
    moving = iter([False, True, False, False, True, False, False, False, False])
    grip = MotionTakeoverTrigger(lambda: next(moving), rest_steps=3)
    told = [grip() for _ in range(9)]
    assert told == [None, "take", None, None, "take", None, None, "release", "release"]
    with pytest.raises(PolicyError, match="rest_steps is 0"):
        MotionTakeoverTrigger(lambda: True, rest_steps=0)


def test_policies_of_different_robots_are_refused():
    with pytest.raises(PolicyError, match=r"hanger.*pickers"):
        TakeoverPolicy(registry.make("hold", HANGER), registry.make("hold", PICKERS), lambda: None)
