"""Commands that are unsafe are refused before they are sent."""

import numpy as np
import pytest

from layflat.app.hardware.safety_limits import RefusedCommandError, SafetyLimits
from layflat.app.hardware.station_config import RobotConfig

HERE = np.array([0.1, 0.0, 0.2])
LIMITS = SafetyLimits(RobotConfig(host="", force_n=12.0, speed_m_s=0.25))


def allowed(wanted: list[float], measured: np.ndarray = HERE, current: np.ndarray = HERE) -> np.ndarray:
    return LIMITS.allowed(current, np.array(wanted), measured, 0.1)


def test_a_usual_step_is_sent_as_it_is() -> None:
    assert allowed([0.12, 0.0, 0.19]) == pytest.approx([0.12, 0.0, 0.19])


def test_a_little_beyond_the_workspace_ends_at_its_border() -> None:
    low = np.array([0.1, 0.0, 0.008])
    assert allowed([0.1, 0.0, -0.006], low, low)[2] == pytest.approx(0.004)


@pytest.mark.parametrize(
    ("wanted", "says"),
    [
        ([0.1, 0.0, 0.24], "jumps: 0.40 m/s, where the station allows 0.25"),
        ([0.9, 0.0, 0.2], "30 cm outside the workspace"),
        ([np.nan, 0.0, 0.2], "must be finite"),
        ([np.inf, 0.0, 0.2], "must be finite"),
    ],
)
def test_what_is_unsafe_is_refused(wanted: list[float], says: str) -> None:
    with pytest.raises(RefusedCommandError, match=says):
        allowed(wanted)


def test_a_blocked_arm_is_pulled_by_a_bounded_force() -> None:
    """12 N at 400 N/m: the set point stays within 3 cm of the hanger."""
    stuck, set_point = HERE, HERE
    for _ in range(20):
        set_point = LIMITS.allowed(set_point, set_point + np.array([0.01, 0.0, 0.0]), stuck, 0.1)
    assert set_point - stuck == pytest.approx([0.03, 0.0, 0.0])
