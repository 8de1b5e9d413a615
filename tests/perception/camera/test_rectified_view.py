"""The rectified view: a map in millimetres for any tilt of the camera."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from layflat.perception.arrays import bounding_window, touches_border
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.camera.rectified_view import TableRectifier
from layflat.perception.camera.table_grid import TableGrid
from layflat.tests.perception.factories import TILTED, render

GRID = TableGrid()


def square_mask(camera: PinholeCamera, centre: tuple[float, float], side: float, yaw: float = 0.3) -> np.ndarray:
    """Camera pixels whose ray meets the table within a square, computed per pixel without the homography."""
    rows, columns = np.mgrid[: camera.height, : camera.width]
    rays = camera.back_project(np.column_stack([columns.ravel(), rows.ravel()]), np.ones(rows.size)) - camera.position
    points = camera.position + rays * (-camera.position[2] / rays[:, 2:])
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    inside = (np.abs((points[:, :2] - centre) @ turn) <= side / 2).all(axis=1)
    return inside.reshape(rows.shape)


@given(seed=st.integers(0, 2**16))
def test_grid_coordinates_round_trip(seed):
    points = np.random.default_rng(seed).uniform(-0.3, 0.8, (10, 2))
    np.testing.assert_allclose(GRID.to_table(GRID.to_pixel(points)), points, atol=1e-12)


def test_columns_run_to_x_and_rows_against_y():
    (left_top, right_top, left_bottom) = GRID.to_table([(0, 0), (GRID.width - 1, 0), (0, GRID.height - 1)])
    half = GRID.metres_per_px / 2
    np.testing.assert_allclose(left_top, (GRID.x_min + half, GRID.y_max - half))
    np.testing.assert_allclose(right_top, (GRID.x_max - half, GRID.y_max - half))
    np.testing.assert_allclose(left_bottom, (GRID.x_min + half, GRID.y_min + half))
    assert (GRID.width, GRID.height) == (420, 320)


@pytest.mark.parametrize("position", [(0.25, -0.6, 0.75), (0.5, -0.5, 0.6), (0.25, -0.01, 1.0)])
def test_a_square_counts_the_same_wherever_it_lies(position):
    camera = PinholeCamera.look_at(position, (0.25, 0.0, 0.0), width=320, height=240, fx=280.0)
    view = TableRectifier(camera, GRID)
    side = 0.2
    wanted = side**2 / GRID.metres_per_px**2
    for centre in [(0.25, 0.0), (0.1, -0.08), (0.4, 0.1), (0.15, 0.12), (0.4, -0.1)]:
        assert view.rectify_mask(square_mask(camera, centre, side)).sum() == pytest.approx(wanted, rel=0.02)


def test_a_small_square_lands_on_its_table_coordinates():
    view = TableRectifier(TILTED, GRID)
    for centre in [(0.1, -0.1), (0.25, 0.0), (0.42, 0.15)]:
        rows, columns = np.nonzero(view.rectify_mask(square_mask(TILTED, centre, 0.05)))
        found = GRID.to_table([columns.mean(), rows.mean()])[0]
        np.testing.assert_allclose(found, centre, atol=0.002)


def test_beyond_the_image_and_behind_the_camera_is_empty():
    camera = PinholeCamera.look_at((0.0, 0.0, 0.3), (0.4, 0.0, 0.0), width=64, height=48, fx=60.0)
    view = TableRectifier(camera, TableGrid(x_min=-2.0, x_max=2.0, y_min=-1.0, y_max=1.0, mm_per_px=20.0))
    seen = view.rectify(np.full((48, 64), 255, dtype=np.uint8))
    rows, columns = np.nonzero(seen)
    xy = view.grid.to_table(np.column_stack([columns, rows]))
    assert len(xy) > 100
    assert xy[:, 0].min() > 0.0


def test_window_of_the_view_is_a_part_of_the_whole():
    rgb = render(None, seed=0).rgb
    view = TableRectifier(TILTED, GRID)
    window = (slice(30, 90), slice(101, 222))
    np.testing.assert_array_equal(view.rectify(rgb, window), view.rectify(rgb)[window])


def test_bounding_window_and_border():
    mask = np.zeros((10, 12), dtype=bool)
    assert bounding_window(mask) is None
    mask[4, 5] = mask[6, 7] = True
    assert bounding_window(mask) == (slice(4, 7), slice(5, 8))
    assert bounding_window(mask, margin=6) == (slice(0, 10), slice(0, 12))
    assert not touches_border(mask)
    for pixel in [(0, 3), (9, 3), (3, 0), (3, 11)]:
        edged = mask.copy()
        edged[pixel] = True
        assert touches_border(edged)


def test_a_mask_is_wholly_within_its_window():
    view = TableRectifier(TILTED, TableGrid())
    rng = np.random.default_rng(5)
    for _ in range(30):
        top, left = rng.integers(0, 200), rng.integers(0, 280)
        mask = np.zeros((240, 320), dtype=bool)
        mask[top : top + rng.integers(1, 60), left : left + rng.integers(1, 80)] = True
        whole, window = view.rectify_mask(mask), view.grid_window(mask)
        if window is None:
            assert not whole.any()
            continue
        part = np.zeros_like(whole)
        part[window] = view.rectify_mask(mask, window)
        np.testing.assert_array_equal(part, whole)
    assert view.grid_window(np.zeros((240, 320), dtype=bool)) is None
