"""A person is a policy like any other."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.app.workstation.teleop.teleop_input import TeleopInput, zero_input
from layflat.app.workstation.teleop.teleop_policy import TeleopPolicy
from layflat.data.types import ACTION_LIMIT_M, Observation
from layflat.policy.base import Policy
from layflat.tests.factories import ROBOT_SPECS

SEEN = Observation(
    time_s=0.0, corner_positions=np.zeros((2, 3)), holder_position=np.zeros(3), word=np.zeros(2), word_strength=0.0,
    contact_portion=0.0,
)  # fmt: skip


@pytest.mark.parametrize("robot", ROBOT_SPECS, ids=str)
def test_it_decides_what_the_newest_input_says(robot):
    newest = [zero_input(robot)]
    person = TeleopPolicy(robot, "gamepad", lambda: newest[0])
    assert isinstance(person, Policy)
    assert (person.name, person.robot) == ("gamepad", robot)
    person.reset(3)
    assert not person.act(SEEN).action.any()
    rng = np.random.default_rng(0)
    for _ in range(20):
        newest[0] = TeleopInput(motion=rng.uniform(-1, 1, robot.size), speed=rng.uniform())
        decision = person.act(SEEN)
        assert decision.action == pytest.approx(newest[0].motion * newest[0].speed * ACTION_LIMIT_M)
        assert (decision.stop, decision.hand) == (None, None)
        assert decision.reason
    hand = rng.normal(size=robot.hand_shape)
    newest[0] = TeleopInput(motion=robot.zeros(), hand=hand)
    assert (person.act(SEEN).hand == hand).all()
