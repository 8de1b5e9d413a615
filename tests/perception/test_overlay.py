"""The drawing stands where the cloth is."""

from __future__ import annotations

import math

import numpy as np
import pytest

from layflat.perception.cloth.pipeline import PerceptionPipeline
from layflat.perception.overlay import ARROW, ARROW_M, CONTACT, draw_cloth_state
from layflat.tests.perception.factories import TILTED, render, wrinkled_sheet


@pytest.mark.parametrize("scale", [1, 3])
def test_contact_is_tinted_where_it_is_and_nowhere_else(scale):
    frame = render(wrinkled_sheet(lift_x=0.25))
    before = frame.rgb.copy()
    state = PerceptionPipeline(TILTED, None, 19600).perceive(frame.rgb, frame.depth)
    picture = draw_cloth_state(frame.rgb, state, TILTED, scale=scale)
    assert picture.shape == (240 * scale, 320 * scale, 3)
    assert picture.dtype == np.uint8
    np.testing.assert_array_equal(frame.rgb, before)
    (lying, raised, bare), _ = TILTED.project([(0.15, -0.1, 0.004), (0.4, -0.1, 0.079), (0.0, 0.1, 0.0)])
    for pixel, tinted in ((lying, True), (raised, False), (bare, False)):
        column, row = np.rint(pixel).astype(int)
        seen = picture[row * scale + scale // 2, column * scale + scale // 2].astype(int)
        towards = np.abs(seen - CONTACT).sum() < np.abs(frame.rgb[row, column].astype(int) - CONTACT).sum()
        assert towards == tinted


def test_arrow_points_along_word_from_the_contact_centroid():
    frame = render(wrinkled_sheet(amplitude=0.0015, normal=0.6))
    state = PerceptionPipeline(TILTED, None, 19600).perceive(frame.rgb, frame.depth)
    picture = draw_cloth_state(frame.rgb, state, TILTED)
    rows, columns = np.nonzero(state.contact_mask)
    start = state.grid.to_table([columns.mean(), rows.mean()])[0]
    middle = start + 0.4 * ARROW_M * state.word
    (pixel,), _ = TILTED.project([(*middle, 0.0)])
    column, row = np.rint(pixel).astype(int)
    np.testing.assert_allclose(picture[row, column], ARROW, atol=12)


def test_every_kind_of_percept_can_be_drawn():
    pipeline = PerceptionPipeline(TILTED)
    for sheet in (None, wrinkled_sheet(), wrinkled_sheet(rest=0.2), wrinkled_sheet(centre=(0.7, 0.0), amplitude=0.003)):
        frame = render(sheet)
        state = pipeline.perceive(frame.rgb, frame.depth)
        assert math.isnan(state.contact_portion)
        assert draw_cloth_state(frame.rgb, state, TILTED).shape == (240, 320, 3)
