"""A cloth that swings ahead is held up until it hangs still; any other is not touched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from layflat.data.robot import RobotSpec
from layflat.policy.wrappers.swing_damping import WAIT_STEPS, SwingDampingWrapper
from layflat.tests.factories import HANGER, ROBOT_SPECS
from layflat.tests.lowering import Down

LENGTH_M = 0.35
PERIOD_STEPS = 10.0


def lower(robot: RobotSpec, observe, *, swing_m: float, fades: float = 8.0, z: float = 0.36) -> tuple[list[str], float]:
    """Reasons of all decisions until the free edge touches, and how far ahead of the holder it is then."""
    policy = SwingDampingWrapper(Down(robot))
    policy.reset(0)
    reasons: list[str] = []
    for step_index in range(200):
        ahead = swing_m * np.cos(2 * np.pi * step_index / PERIOD_STEPS) * np.exp(-step_index / fades)
        low = z - np.sqrt(LENGTH_M**2 - ahead**2)
        if low <= 0:
            return reasons, float(ahead)
        decision = policy.act(replace(observe(0.1, z), free_edge_m=np.array([0.1 + ahead, 0.0, low])))
        reasons.append(decision.reason)
        z += float(decision.action[-1])
    raise AssertionError("it never comes down")


@pytest.mark.parametrize("robot", ROBOT_SPECS)
def test_a_swing_ahead_is_waited_for(robot: RobotSpec, observe) -> None:
    plainly = max(
        0.1 * np.cos(2 * np.pi * step_index / PERIOD_STEPS) * np.exp(-step_index / 8.0) for step_index in (1, 2)
    )
    assert plainly > 0.03, "without waiting it would touch ahead"
    reasons, ahead = lower(robot, observe, swing_m=0.1)
    assert "waiting" in reasons[0]
    assert reasons[-1] == "down"
    assert abs(ahead) < 0.02


@pytest.mark.parametrize("swing_m", [0.0, 0.02, -0.1])
def test_a_cloth_that_hangs_still_or_behind_is_not_held_up(swing_m: float, observe) -> None:
    reasons, _ = lower(HANGER, observe, swing_m=swing_m, fades=3.0)
    assert set(reasons) == {"down"}


def test_high_up_a_swing_does_not_matter(observe) -> None:
    policy = SwingDampingWrapper(Down(HANGER))
    policy.reset(0)
    seen = replace(observe(0.0, 0.5), free_edge_m=np.array([0.1, 0.0, 0.16]))
    assert policy.act(seen).reason == "down"


def test_waiting_has_an_end(observe) -> None:
    policy = SwingDampingWrapper(Down(HANGER))
    for _ in range(2):
        policy.reset(0)
        reasons = [
            policy.act(replace(observe(0.0, 0.36), free_edge_m=np.array([0.1 * (-1) ** k, 0.0, 0.02]))).reason
            for k in range(3 * WAIT_STEPS)
        ]
        assert sum("waiting" in reason for reason in reasons) == WAIT_STEPS
        assert reasons[-1] == "down"


def test_on_the_table_and_without_a_camera_the_policy_decides(observe) -> None:
    policy = SwingDampingWrapper(Down(HANGER))
    policy.reset(0)
    ahead = np.array([0.2, 0.0, 0.004])
    assert policy.act(replace(observe(0.1, 0.05, contact=0.7), free_edge_m=ahead)).reason == "down"
    assert policy.act(replace(observe(0.1, 0.36), free_edge_m=None)).reason == "down"
