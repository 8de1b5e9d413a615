"""Cloths from 0.15 to 0.60 m, any aspect: the arm reaches, and the camera sees, where they are laid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from layflat.data.robot import RobotSpec
from layflat.sim.camera.camera import POSITION_M, default_pinhole
from layflat.sim.cloth.registry import CLOTHS
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.robots.hanger import PandaHanger
from layflat.sim.robots.pickers import FreePickers
from layflat.sim.starts.base import home_corners

TOWEL = CLOTHS["towel"]
JOINT_LIMITS = np.array([2.8973, 1.7628, 2.8973, np.nan, 2.8973, np.nan, 2.8973])
SIZES = [(length, width) for length in (0.15, 0.35, 0.45, 0.60) for width in (0.15, 0.35, 0.60)]


@pytest.fixture(params=SIZES, ids=lambda size: f"{size[0]}x{size[1]}")
def cloth(request: pytest.FixtureRequest) -> ClothSpec:
    return replace(TOWEL, length_m=request.param[0], width_m=request.param[1])


def laid(cloth: ClothSpec) -> np.ndarray:
    """Return places of the held edge's middle: at the start, on the way, laid, and dragged a quarter further."""
    home, length = cloth.home_x_m, cloth.length_m
    return np.array(
        [
            [home - 0.05, 0.0, length + 0.15],
            [home + 0.05, 0.0, length + 0.12],
            *([home + share * length, 0.0, np.sqrt(1 - share**2) * length + 0.004] for share in np.linspace(0, 1, 9)),
            [home + 1.25 * length, 0.0, 0.004],
        ]
    )


@pytest.mark.parametrize("robot", [PandaHanger, FreePickers])
def test_a_robot_may_go_where_a_cloth_is_laid(robot: type, cloth: ClothSpec) -> None:
    low, high = robot.workspace(cloth)
    for place in laid(cloth):
        np.testing.assert_allclose(np.clip(place, low, high), place, atol=0.011)
    assert isinstance(robot.spec, RobotSpec)
    home = home_corners(cloth)
    np.testing.assert_array_equal(robot.within_reach(home, cloth), home)


def test_the_arm_reaches_it_within_its_joints(cloth: ClothSpec) -> None:
    for place in laid(cloth):
        angles = PandaHanger.joint_angles_at(place, cloth)
        outside = np.abs(angles) > JOINT_LIMITS - 0.05
        assert not outside.any(), f"joint {np.flatnonzero(outside) + 1} at {place}"
        assert -3.0718 < angles[3] < -0.0698
        assert -0.0175 < angles[5] < 3.7525


def test_the_camera_sees_the_cloth_and_room_to_drag_it(cloth: ClothSpec) -> None:
    pinhole = default_pinhole(cloth)
    x = cloth.home_x_m + np.array([-0.1, 1.25]) * cloth.length_m
    corners = np.array([[a, b, 0.0] for a in x for b in (-cloth.width_m / 2, cloth.width_m / 2)])
    seen = np.linalg.inv(pinhole.cam_to_world) @ np.column_stack([corners, np.ones(len(corners))]).T
    columns, rows = pinhole.fx * seen[:2] / seen[2] + np.array([[pinhole.cx], [pinhole.cy]])
    assert 0 < columns.min() < columns.max() < pinhole.width
    assert 0 < rows.min() < rows.max() < pinhole.height


def test_nothing_changes_for_a_cloth_that_is_not_longer_than_the_towel() -> None:
    small = replace(TOWEL, length_m=0.2, width_m=0.3)
    for cloth in (TOWEL, small, CLOTHS["napkin"]):
        pinhole = default_pinhole(cloth)
        np.testing.assert_array_equal(pinhole.position, POSITION_M)
        assert pinhole.fx == default_pinhole().fx
        low, high = PandaHanger.workspace(cloth)
        np.testing.assert_array_equal([low, high], [PandaHanger.workspace_low_m, PandaHanger.workspace_high_m])
