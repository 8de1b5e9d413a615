"""A cloth that swings ahead is held up until it hangs still; any other is not touched."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.data.robot import RobotSpec
from layflat.policy.wrappers.swing_damping import WAIT_STEPS, SwingDampingWrapper
from layflat.tests.factories import HANGER, ROBOT_SPECS
from layflat.tests.fake_environment import DownPolicy
from layflat.tests.policy.factories import observe

LENGTH_M = 0.35
PERIOD_STEPS = 10.0


def damped(robot: RobotSpec) -> SwingDampingWrapper:
    policy = SwingDampingWrapper(DownPolicy(robot))
    policy.reset(0)
    return policy


def ahead_m(k: int, swing_m: float, fades: float) -> float:
    """x of the swinging free edge relative to the holder at a step."""
    return float(swing_m * np.cos(2 * np.pi * k / PERIOD_STEPS) * np.exp(-k / fades))


def lower(robot: RobotSpec, *, swing_m: float, fades: float = 8.0, z: float = 0.36) -> tuple[list[str], float]:
    """Reasons of all decisions until the free edge touches, and how far ahead of the holder it is then."""
    policy, reasons = damped(robot), []
    for k in range(200):
        ahead = ahead_m(k, swing_m, fades)
        low = z - np.sqrt(LENGTH_M**2 - ahead**2)
        if low <= 0:
            return reasons, ahead
        decision = policy.act(observe(0.1, z, free_edge_m=(0.1 + ahead, 0.0, low)))
        reasons.append(decision.reason)
        z += float(robot.unpack(decision.action)[0, 2])
    raise AssertionError("it never comes down")


@pytest.mark.parametrize("robot", ROBOT_SPECS)
def test_a_swing_ahead_is_waited_for(robot: RobotSpec) -> None:
    assert max(ahead_m(k, 0.1, 8.0) for k in (1, 2)) > 0.03, "without waiting it would touch ahead"
    reasons, ahead = lower(robot, swing_m=0.1)
    assert "waiting" in reasons[0]
    assert reasons[-1] == "down"
    assert abs(ahead) < 0.02


@pytest.mark.parametrize("swing_m", [0.0, 0.02, -0.1])
def test_a_cloth_that_hangs_still_or_behind_is_not_held_up(swing_m: float) -> None:
    reasons, _ = lower(HANGER, swing_m=swing_m, fades=3.0)
    assert set(reasons) == {"down"}


def test_waiting_has_an_end() -> None:
    policy = damped(HANGER)
    for _ in range(2):
        policy.reset(0)
        seen = [observe(0.0, 0.36, free_edge_m=(0.1 * (-1) ** k, 0.0, 0.02)) for k in range(3 * WAIT_STEPS)]
        reasons = [policy.act(observation).reason for observation in seen]
        assert sum("waiting" in reason for reason in reasons) == WAIT_STEPS
        assert reasons[-1] == "down"


@pytest.mark.parametrize(
    "seen",
    [
        observe(0.0, 0.5, free_edge_m=(0.1, 0.0, 0.16)),
        observe(0.1, 0.05, contact=0.7, free_edge_m=(0.2, 0.0, 0.004)),
        observe(0.1, 0.36, free_edge_m=None),
    ],
    ids=["high up", "on the table", "without a camera"],
)
def test_elsewhere_the_policy_decides(seen) -> None:
    assert damped(HANGER).act(seen).reason == "down"
