"""What a lens may be, and that it projects as the pinhole does."""

from __future__ import annotations

import math

import numpy as np
import pytest

from layflat.perception.camera.intrinsics import Intrinsics


@pytest.mark.parametrize(
    ("size", "field_of_view_deg"), [((640, 480), 55.0), ((848, 480), 69.4), ((1280, 720), 69.4), ((1920, 1080), 69.4)]
)
def test_the_assumed_camera_has_the_data_sheets_field_of_view(size, field_of_view_deg):
    lens = Intrinsics.d435(*size)
    assert 2 * math.degrees(math.atan(lens.width / 2 / lens.fx)) == pytest.approx(field_of_view_deg, abs=1.0)
    assert lens.fx == lens.fy


def test_slopes_are_those_of_the_pinhole():
    lens = Intrinsics(width=100, height=80, fx=90.0, fy=85.0, cx=48.5, cy=41.0)
    pose = np.diag([1.0, -1.0, -1.0, 1.0])  # straight down
    pose[2, 3] = 2.0
    rows, columns = np.array([0, 41, 79]), np.array([7, 48, 99])
    points = lens.camera_at(pose).back_project(np.column_stack([columns, rows]), np.full(3, 2.0))
    np.testing.assert_allclose(lens.ray_slopes(rows, columns) * 2.0 * (1, -1), points[:, :2])
