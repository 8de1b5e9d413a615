"""Contact from noisy depth."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.cloth.contact import (
    MAX_HEIGHT_M,
    MAX_STRETCH,
    MIN_HEIGHT_M,
    MIN_PIXELS,
    contact_mask,
    contact_portion,
    covered_pixels,
    free_edge,
    smooth_height,
)
from layflat.perception.errors import PerceptionError

HEIGHTS = arrays(np.float32, (9, 11), elements=st.floats(-(2**-7), 3 * 2**-6, width=32))
MASKS = arrays(np.bool_, (9, 11))


@given(height=HEIGHTS, cloth=MASKS, low=st.floats(0, 0.05), high=st.floats(0, 0.05))
def test_contact_grows_with_its_threshold(height, cloth, low, high):
    low, high = sorted((low, high))
    less, more = contact_mask(cloth, height, low), contact_mask(cloth, height, high)
    assert not (less & ~more).any()
    assert not (more & ~cloth).any()


@given(height=HEIGHTS, cloth=MASKS, gaps=MASKS)
def test_smoothing_is_the_mean_of_valid_cloth(height, cloth, gaps):
    holey = np.where(gaps, np.nan, height).astype(np.float32)
    valid = cloth & ~gaps
    if not valid.any():
        return
    smooth = smooth_height(holey, cloth, size_px=5)
    for row, column in np.argwhere(cloth):
        part = (slice(max(0, row - 2), row + 3), slice(max(0, column - 2), column + 3))
        near = valid[part]
        if near.any():
            assert smooth[row, column] == pytest.approx(height[part][near].mean(), abs=1e-6)
        else:
            assert height.min() - 1e-6 <= smooth[row, column] <= height.max() + 1e-6


def test_missing_depth_is_filled_however_large_the_hole():
    cloth = np.ones((60, 60), dtype=bool)
    height = np.full((60, 60), 0.004, dtype=np.float32)
    height[10:50, 10:50] = np.nan
    assert contact_mask(cloth, smooth_height(height, cloth), 0.008).all()
    height[~np.isnan(height)] = 0.02
    assert not contact_mask(cloth, smooth_height(height, cloth), 0.008).any()


def test_the_table_does_not_draw_a_lifted_rim_down():
    cloth = np.zeros((20, 20), dtype=bool)
    cloth[5:15, 5:15] = True
    smooth = smooth_height(np.where(cloth, 0.012, 0.0).astype(np.float32), cloth)
    np.testing.assert_allclose(smooth[cloth], 0.012, atol=1e-6)


def test_one_wild_value_does_not_lift_its_neighbours():
    cloth = np.ones((15, 15), dtype=bool)
    for wild in (5.0, -5.0):
        height = np.full((15, 15), 0.004, dtype=np.float32)
        height[7, 7] = wild
        assert contact_mask(cloth, smooth_height(height, cloth), 0.008).all()
    assert MIN_HEIGHT_M < 0 < MAX_HEIGHT_M


@pytest.mark.parametrize(("height_m", "message"), [(np.nan, "no cloth pixel has a depth"), (-0.3, "below the table")])
def test_a_dead_camera_and_a_cloth_under_the_table_are_errors(height_m, message):
    with pytest.raises(PerceptionError, match=message):
        smooth_height(np.full((5, 5), height_m, dtype=np.float32), np.ones((5, 5), dtype=bool))


@given(flat=st.integers(1, 10**6), seen=st.floats(0, 1), lying=st.floats(0, 1))
def test_contact_portion_is_the_ratio_of_eq_4_7(flat, seen, lying):
    """As long as no more cloth is seen than there is: what is hidden, folded or lifted away is not in contact."""
    contact = int(lying * seen * flat)
    assert contact_portion(contact, covered=seen * flat, flat_pixels=flat) == contact / flat


@given(flat=st.integers(10**4, 10**6), stretch=st.floats(1.0, MAX_STRETCH), share=st.floats(0, 1))
def test_a_stretched_cloth_is_not_more_in_contact(flat, stretch, share):
    contact = int(share * stretch * flat)
    portion = contact_portion(contact, covered=stretch * flat, flat_pixels=flat)
    assert portion == pytest.approx(share, abs=2e-4)
    assert portion <= 1.0 + 1e-12


def test_a_cloth_that_no_stretch_explains_is_noticed():
    """A napkin's P_flat with a towel in view: the portion says that something is wrong, it is not hidden as 1."""
    assert contact_portion(19_600, covered=19_600, flat_pixels=9_460) > 1.9
    with pytest.raises(PerceptionError, match="flat_pixels is 0"):
        contact_portion(5, covered=5, flat_pixels=0)


@pytest.mark.parametrize("height_m", [0.0, 0.004, 0.008, 0.02, 0.05])
def test_a_raised_cloth_covers_what_it_would_on_the_table(height_m):
    """Drawn by similar triangles: at height h under a camera at H it is H / (H - h) times as long and as wide."""
    camera_m, level_m, side = 0.8, 0.008, 100.0
    drawn = round(side * (camera_m - level_m) / (camera_m - max(height_m, level_m)))
    cloth = np.zeros((120, 120), dtype=bool)
    cloth[:drawn, :drawn] = True
    height = np.full(cloth.shape, height_m, np.float32)
    heights = {"contact_height_m": level_m, "camera_height_m": camera_m}
    assert covered_pixels(cloth, height, **heights) == pytest.approx(side**2, rel=0.01)
    assert covered_pixels(cloth & False, height, **heights) == 0.0


CAMERA = PinholeCamera.look_at((0.15, -0.72, 0.86), (0.285, 0.065, 0.0), width=320, height=240, fx=307.5)

PIXEL_M = 0.005
"""What a pixel's rounding moves a height by: 1 m of distance, seen at a slant."""


def hanging(x_m: float, low_m: float, rng: np.random.Generator, noise_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Mask and depth of a sheet, 0.3 m wide and high, that hangs in the plane x = ``x_m`` + 0.2 (z - ``low_m``)."""
    along, across = np.meshgrid(np.linspace(0.0, 0.3, 900), np.linspace(-0.15, 0.15, 900))
    points = np.stack([x_m + 0.2 * along, across, low_m + along], axis=-1).reshape(-1, 3)
    pixels, depth = CAMERA.project(points)
    u, v = np.rint(pixels).astype(int).T
    seen = (u >= 0) & (u < 320) & (v >= 0) & (v < 240)
    mask, image = np.zeros((240, 320), dtype=bool), np.zeros((240, 320), dtype=np.float32)
    mask[v[seen], u[seen]] = True
    image[v[seen], u[seen]] = depth[seen]
    return mask, np.where(mask, image + rng.normal(0.0, noise_m, image.shape), 0.0).astype(np.float32)


@pytest.mark.parametrize("low_m", [0.01, 0.1])
@pytest.mark.parametrize("x_m", [-0.05, 0.1, 0.3])
def test_the_free_edge_is_found(x_m, low_m):
    rng = np.random.default_rng(1)
    exact = free_edge(CAMERA, *hanging(x_m, low_m, rng, 0.0))
    noisy = free_edge(CAMERA, *hanging(x_m, low_m, rng, 0.003))
    assert exact is not None
    assert noisy is not None
    # Of 0.3 m a twentieth is 15 mm.
    assert low_m - PIXEL_M < exact[2] < low_m + 0.015 + PIXEL_M
    assert exact[0] == pytest.approx(x_m, abs=PIXEL_M)
    assert exact[1] == pytest.approx(0.0, abs=0.15)
    np.testing.assert_allclose(noisy[[0, 2]], exact[[0, 2]], atol=0.008)


def test_where_the_sensor_is_blind_or_sees_next_to_nothing_there_is_none():
    mask, depth = hanging(0.1, 0.05, np.random.default_rng(0), 0.0)
    assert free_edge(CAMERA, mask, np.zeros_like(depth)) is None
    rows, columns = np.nonzero(mask)
    few = np.zeros_like(mask)
    few[rows[: MIN_PIXELS - 1], columns[: MIN_PIXELS - 1]] = True
    assert free_edge(CAMERA, few, depth) is None
