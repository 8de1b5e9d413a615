"""Contact from noisy depth."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from perception.contact import HIGHEST_M, LOWEST_M, contact_mask, contact_portion, smooth_height
from perception.errors import PerceptionError

HEIGHTS = arrays(np.float32, (9, 11), elements=st.floats(-(2**-7), 3 * 2**-6, width=32))
MASKS = arrays(np.bool_, (9, 11))


@given(height=HEIGHTS, cloth=MASKS, low=st.floats(0, 0.05), high=st.floats(0, 0.05))
def test_contact_grows_with_its_threshold(height: np.ndarray, cloth: np.ndarray, low: float, high: float) -> None:
    low, high = sorted((low, high))
    less, more = contact_mask(cloth, height, low), contact_mask(cloth, height, high)
    assert not (less & ~more).any()
    assert not (more & ~cloth).any()


@given(height=HEIGHTS, cloth=MASKS, gaps=MASKS)
def test_smoothing_is_the_mean_of_valid_cloth(height: np.ndarray, cloth: np.ndarray, gaps: np.ndarray) -> None:
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


def test_missing_depth_is_filled_however_large_the_hole() -> None:
    cloth = np.ones((60, 60), dtype=bool)
    height = np.full((60, 60), 0.004, dtype=np.float32)
    height[10:50, 10:50] = np.nan
    assert contact_mask(cloth, smooth_height(height, cloth), 0.008).all()
    height[~np.isnan(height)] = 0.02
    assert not contact_mask(cloth, smooth_height(height, cloth), 0.008).any()


def test_the_table_does_not_draw_a_lifted_rim_down() -> None:
    cloth = np.zeros((20, 20), dtype=bool)
    cloth[5:15, 5:15] = True
    smooth = smooth_height(np.where(cloth, 0.012, 0.0).astype(np.float32), cloth)
    np.testing.assert_allclose(smooth[cloth], 0.012, atol=1e-6)


def test_one_wild_value_does_not_lift_its_neighbours() -> None:
    cloth = np.ones((15, 15), dtype=bool)
    for wild in (5.0, -5.0):
        height = np.full((15, 15), 0.004, dtype=np.float32)
        height[7, 7] = wild
        assert contact_mask(cloth, smooth_height(height, cloth), 0.008).all()
    assert LOWEST_M < 0 < HIGHEST_M


def test_a_dead_depth_camera_is_an_error_not_a_lifted_cloth() -> None:
    cloth = np.ones((5, 5), dtype=bool)
    with pytest.raises(PerceptionError, match="no cloth pixel has a depth"):
        smooth_height(np.full((5, 5), np.nan, dtype=np.float32), cloth)


def test_a_cloth_under_the_table_is_an_error_not_contact() -> None:
    with pytest.raises(PerceptionError, match="below the table"):
        smooth_height(np.full((5, 5), -0.3, dtype=np.float32), np.ones((5, 5), dtype=bool))


def test_contact_portion_is_the_ratio() -> None:
    assert contact_portion(5228, 10000) == pytest.approx(0.5228)
    assert contact_portion(0, 7) == 0.0
    with pytest.raises(PerceptionError, match="flat_pixels is 0"):
        contact_portion(5, 0)
