"""The camera model: projection, depth and the table plane agree with each other."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from layflat.perception.camera.pinhole import PinholeCamera
from layflat.tests.perception.factories import TILTED

POSITIONS = st.tuples(st.floats(-0.5, 0.8), st.floats(-0.9, -0.3), st.floats(0.3, 1.2))


def camera_at(position: tuple[float, float, float]) -> PinholeCamera:
    return PinholeCamera.look_at(position, (0.25, 0.0, 0.0), width=64, height=48, fx=61.0)


def table_depth(camera: PinholeCamera) -> np.ndarray:
    """Depth image of the bare table, by intersecting each ray with z = 0 in plain linear algebra."""
    depth = np.zeros((camera.height, camera.width))
    for row in range(camera.height):
        for column in range(camera.width):
            ray = np.array([(column - camera.cx) / camera.fx, (row - camera.cy) / camera.fy, 1.0])
            dz = camera.cam_to_world[2, :3] @ ray
            depth[row, column] = -camera.position[2] / dz if dz < 0 else 0.0
    return depth


@given(position=POSITIONS, seed=st.integers(0, 2**16))
def test_projection_and_back_projection_are_inverse(position, seed):
    camera = camera_at(position)
    points = np.random.default_rng(seed).uniform((-0.2, -0.2, 0.0), (0.7, 0.2, 0.2), (20, 3))
    pixels, depth = camera.project(points)
    np.testing.assert_allclose(camera.back_project(pixels, depth), points, atol=1e-9)


def test_projection_agrees_with_opencv():
    points = np.random.default_rng(0).uniform((0.0, -0.2, 0.0), (0.5, 0.2, 0.2), (50, 3))
    world_to_cam = np.linalg.inv(TILTED.cam_to_world)
    rotation, _ = cv2.Rodrigues(world_to_cam[:3, :3])
    theirs, _ = cv2.projectPoints(points, rotation, world_to_cam[:3, 3], TILTED.matrix, None)
    np.testing.assert_allclose(TILTED.project(points)[0], theirs[:, 0], atol=1e-6)


def test_target_is_in_the_centre_and_up_is_up():
    camera = camera_at((0.25, -0.6, 0.75))
    (centre, above, right), depth = camera.project([(0.25, 0, 0), (0.25, 0, 0.1), (0.35, 0, 0)])
    np.testing.assert_allclose(centre, (31.5, 23.5), atol=1e-9)
    assert depth[0] == pytest.approx(np.hypot(0.6, 0.75))
    assert above[1] < centre[1]
    assert right[0] > centre[0]


@given(position=POSITIONS)
def test_bare_table_has_height_zero_everywhere(position):
    camera = PinholeCamera.look_at(position, (0.25, 0.0, 0.0), width=16, height=12, fx=15.0)
    depth = table_depth(camera)
    height = camera.height_above_table(depth.astype(np.float32))
    seen = depth > 0
    np.testing.assert_allclose(height[seen], 0.0, atol=1e-5 * (1 + depth[seen].max()))
    assert np.isnan(height[~seen]).all()


def test_height_of_points_above_the_table_is_their_z():
    column, row, wanted = 200, 90, 0.123
    ray = TILTED.back_project([[column, row]], [1.0])[0] - TILTED.position
    depth = np.zeros((240, 320), dtype=np.float32)
    depth[row, column] = (wanted - TILTED.position[2]) / ray[2]
    height = TILTED.height_above_table(depth)
    assert height[row, column] == pytest.approx(wanted, abs=1e-6)
    assert np.isnan(height).sum() == height.size - 1


@pytest.mark.parametrize("missing", [0.0, -1.0, np.nan, np.inf])
def test_missing_depth_is_nan(missing):
    assert np.isnan(TILTED.height_above_table(np.full((240, 320), missing, dtype=np.float32))).all()


def test_homography_is_projection_of_the_table():
    xy = np.random.default_rng(1).uniform((0, -0.2), (0.5, 0.2), (30, 2))
    pixels, depth = TILTED.project(np.column_stack([xy, np.zeros(30)]))
    mapped = np.column_stack([xy, np.ones(30)]) @ TILTED.table_to_pixel.T
    np.testing.assert_allclose(mapped[:, :2] / mapped[:, 2:], pixels)
    np.testing.assert_allclose(mapped[:, 2], depth)


def test_pose_cannot_be_changed_from_outside():
    pose = np.array(camera_at((0.0, -0.6, 0.7)).cam_to_world)
    camera = PinholeCamera(width=4, height=3, fx=5.0, fy=5.0, cx=1.5, cy=1.0, cam_to_world=pose)
    pose[0, 3] = 99.0
    assert camera.position[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        camera.cam_to_world[0, 3] = 1.0
