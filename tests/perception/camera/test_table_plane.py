"""The table found in depth images of a camera whose place is known to the test only."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.camera.table_plane import TablePlane, fit_table_plane
from layflat.perception.errors import PerceptionError
from layflat.tests.scenes import CLOTHS, Scene, Shot, shoot, stand

ROOM = Scene(box=CLOTHS["red"], amplitude=0.003)


def fit(shot: Shot, cloth: bool = True) -> TablePlane:
    return fit_table_plane(shot.depth, shot.lens, rng=np.random.default_rng(0), cloth=shot.cloth if cloth else None)


def errors(plane: TablePlane, camera: PinholeCamera) -> tuple[float, float]:
    """Degrees between the normals, and mm between the planes under the corners of a cloth of 0.35 m."""
    cosine = float(plane.normal @ camera.cam_to_world[2, :3])
    corners = np.array([[x, y, 0.0] for x in (-0.175, 0.175) for y in (-0.175, 0.175)])
    local = (corners - camera.position) @ camera.cam_to_world[:3, :3]
    return math.degrees(math.acos(min(1.0, cosine))), 1000 * np.abs(local @ plane.normal + plane.distance_m).max()


@pytest.mark.parametrize(("tilt", "roll", "size"), [(0, 0, (320, 240)), (25, -20, (640, 360)), (55, 15, (424, 240))])
def test_without_noise_the_plane_is_exact_for_any_pose(tilt, roll, size):
    camera, lens = stand(tilt=tilt, roll=roll, width=size[0], height=size[1])
    plane = fit(shoot(ROOM, camera, lens))
    angle, height = errors(plane, camera)
    assert angle < 0.02
    assert height < 0.05
    assert plane.tilt_deg == pytest.approx(tilt, abs=0.02)
    assert plane.distance_m == pytest.approx(camera.position[2], abs=1e-4)


@pytest.mark.parametrize(("tilt", "roll"), [(0, 10), (30, 0), (55, -15)])
def test_noise_and_missing_depth_hardly_move_it(tilt, roll):
    camera, lens = stand(tilt=tilt, roll=roll, width=424, height=240)
    plane = fit(shoot(ROOM, camera, lens, seed=3, depth_noise=0.005, missing=0.2))
    angle, height = errors(plane, camera)
    assert angle < 0.15
    assert height < 0.7
    assert 0.001 < plane.rms_m < 0.01


def test_a_cloth_on_most_of_the_table_is_not_taken_for_it():
    camera, lens = stand(tilt=20, width=320, height=240)
    shot = shoot(replace(ROOM, side=0.5, rest=0.02, amplitude=0.0, box=None), camera, lens, seed=1)
    assert shot.cloth.mean() > 0.3
    one, two = fit(shot), fit(shot)
    assert errors(one, camera)[1] < 0.7
    np.testing.assert_array_equal([*one.normal, one.distance_m], [*two.normal, two.distance_m])  # the same seed


def test_the_table_around_the_cloth_counts_not_a_larger_floor():
    camera, lens = stand(tilt=20, distance=1.1, width=320, height=240)
    small = replace(ROOM, table_half=(0.3, 0.3), box=None, floor_z=-0.4)
    shot = shoot(small, camera, lens, seed=2)
    on_floor = np.abs(camera.height_above_table(shot.depth) + 0.4) < 0.05
    on_table = np.abs(camera.height_above_table(shot.depth)) < 0.02
    assert on_floor.sum() > 1.5 * on_table.sum()
    assert errors(fit(shot), camera)[1] < 1.5


@pytest.mark.parametrize(("tilt", "roll"), [(0, 0), (0, 170), (40, 0), (35, 25), (60, -40)])
def test_table_axes_are_the_images(tilt, roll):
    camera, lens = stand(tilt=tilt, roll=roll, turn=70, width=320, height=240)
    normal = camera.cam_to_world[2, :3]
    plane = TablePlane(normal=normal, distance_m=float(camera.position[2]), rms_m=0.0, inlier_share=1.0, n_inliers=9)
    seen = plane.camera(lens)
    assert seen.position == pytest.approx((0.0, 0.0, camera.position[2]))
    # x is the camera's right without its part along the normal; y leaves it to the left, on the image's upper side.
    right_on_table = seen.cam_to_world[:3, 0] * (1, 1, 0)
    np.testing.assert_allclose(right_on_table / np.linalg.norm(right_on_table), (1, 0, 0), atol=1e-12)
    assert seen.cam_to_world[1, 1] < 0  # the image's down has no part in +y
    pixels, _ = seen.project([(0.0, 0.0, 0.0), (1e-4, 0.0, 0.0), (0.0, 1e-4, 0.0)])
    step_x, step_y = pixels[1] - pixels[0], pixels[2] - pixels[0]
    assert step_x[0] > abs(step_x[1])
    assert step_y[1] < 0
    # Heights do not depend on how the table's axes are turned.
    depth = np.full((240, 320), 0.5, np.float32)
    np.testing.assert_allclose(seen.height_above_table(depth), camera.height_above_table(depth), atol=1e-5)


def test_what_is_no_table_is_refused():
    _, lens = stand(width=320, height=240)
    rng = np.random.default_rng(0)
    with pytest.raises(PerceptionError, match="depth has shape"):
        fit_table_plane(np.ones((10, 10), np.float32), lens, rng=rng)
    few = np.zeros((240, 320), np.float32)
    few[:10, :10] = 0.8
    with pytest.raises(PerceptionError, match="100 pixels have a depth"):
        fit_table_plane(few, lens, rng=rng)
    clutter = rng.uniform(0.3, 3.0, (240, 320)).astype(np.float32)
    with pytest.raises(PerceptionError, match="no table: the largest plane holds"):
        fit_table_plane(clutter, lens, rng=rng)
    # 1/z grows with the row below a horizon 20 rows above the middle: tan(tilt) = fy / 20, 86 degrees.
    below = np.maximum(np.arange(240)[:, None] - 99.5, 0.0) * np.ones((1, 320))
    edge_on = np.divide(20.0, below, out=np.zeros_like(below), where=below > 4)
    with pytest.raises(PerceptionError, match="no table"):
        fit_table_plane(edge_on.astype(np.float32), lens, rng=rng)
