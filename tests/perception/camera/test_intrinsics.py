"""What a lens may be, and that it projects as the pinhole does."""

from __future__ import annotations

import math

import numpy as np
import pytest

from layflat.perception.camera.intrinsics import Intrinsics
from layflat.perception.errors import PerceptionError


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


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fx": math.nan}, "finite"),
        ({"cy": math.inf}, "finite"),
        ({"fx": 0.0}, "between"),
        ({"fx": -615.0}, "between"),
        ({"fx": 10.0, "fy": 10.0}, "between"),
        ({"fy": 300.0}, "alike"),
        ({"cx": -1.0}, "within"),
        ({"cy": 481.0}, "within"),
    ],
)
def test_absurd_numbers_are_refused(changes, message):
    good = {"width": 640, "height": 480, "fx": 615.0, "fy": 615.0, "cx": 320.0, "cy": 240.0}
    Intrinsics(**good)  # type: ignore[arg-type]
    with pytest.raises(PerceptionError, match=message):
        Intrinsics(**(good | changes))  # type: ignore[arg-type]
