"""Cloth by colour."""

from __future__ import annotations

import colorsys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from layflat.perception.cloth.segmentation import HsvRange, segment


def painted(colour: tuple[int, ...]) -> np.ndarray:
    """A 30x30 patch of one colour on a grey ground."""
    rgb = np.full((60, 80, 3), 205, dtype=np.uint8)
    rgb[10:40, 20:50] = colour
    return rgb


@given(
    hue=st.floats(0, 359.9),
    saturation=st.floats(0.0, 1.0),
    value=st.floats(0.0, 1.0),
    low=st.integers(0, 359),
    span=st.integers(20, 120),
)
def test_range_agrees_with_the_definition_of_hsv(hue, saturation, value, low, span):
    colour = HsvRange(hue_min=low, hue_max=(low + span) % 360, saturation_min=0.3, value_min=0.3)
    rgb = tuple(round(255 * c) for c in colorsys.hsv_to_rgb(hue / 360, saturation, value))
    h, s, v = colorsys.rgb_to_hsv(*(c / 255 for c in rgb))
    inside = (h * 360 - low) % 360
    margins = [inside / 360, (span - inside) / 360, s - 0.3, v - 0.3]
    if min(abs(m) for m in margins) < 0.012 or inside > 360 * (1 - 0.012):
        return  # within OpenCV's steps of 2 degrees and 1/255 of the edge
    assert segment(painted(rgb), colour).any() == (min(margins) > 0)


def test_cloth_in_light_and_shade_is_found_and_greys_are_not():
    for factor in (0.35, 0.6, 1.0, 1.2):
        cloth = tuple(min(255, int(c * factor)) for c in (40, 90, 200))
        assert segment(painted(cloth), HsvRange()).sum() == pytest.approx(900, rel=0.02)
    for grey in (0, 40, 128, 255):
        assert not segment(painted((grey, grey, grey)), HsvRange()).any()


def test_pinholes_close_and_specks_go():
    rgb = painted((40, 90, 200))
    rgb[20, 30] = rgb[25:27, 40] = 205
    rgb[50, 70] = rgb[5:8, 5:8] = (40, 90, 200)
    mask = segment(rgb, HsvRange())
    assert mask[12:38, 22:48].all()
    mask[10:40, 20:50] = False
    assert not mask.any()


def test_two_pieces_of_cloth_are_both_kept():
    rgb = painted((40, 90, 200))
    rgb[10:40, 34:37] = 60
    # The vote rounds each of the eight corners by 3 px.
    assert segment(rgb, HsvRange()).sum() == pytest.approx(30 * 27, rel=0.035)
