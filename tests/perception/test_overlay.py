"""The drawing stands where the cloth is."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.cloth.pipeline import PerceptionPipeline
from layflat.perception.errors import PerceptionError
from layflat.perception.overlay import ARROW, ARROW_M, CONTACT, draw_cloth_state


@pytest.mark.parametrize("scale", [1, 3])
def test_contact_is_tinted_where_it_is_and_nowhere_else(
    scale: int, tilted_camera: PinholeCamera, render_sheet: Callable, make_sheet: Callable
) -> None:
    frame = render_sheet(tilted_camera, make_sheet(lift_x=0.25))
    before = frame.rgb.copy()
    cloth_state = PerceptionPipeline(tilted_camera, None, 19600).perceive(frame.rgb, frame.depth)
    picture = draw_cloth_state(frame.rgb, cloth_state, tilted_camera, scale=scale)
    assert picture.shape == (240 * scale, 320 * scale, 3)
    assert picture.dtype == np.uint8
    np.testing.assert_array_equal(frame.rgb, before)
    (lying, raised, bare), _ = tilted_camera.project([(0.15, -0.1, 0.004), (0.4, -0.1, 0.079), (0.0, 0.1, 0.0)])
    for pixel, tinted in ((lying, True), (raised, False), (bare, False)):
        column, row = np.rint(pixel).astype(int)
        seen = picture[row * scale + scale // 2, column * scale + scale // 2].astype(int)
        towards = np.abs(seen - CONTACT).sum() < np.abs(frame.rgb[row, column].astype(int) - CONTACT).sum()
        assert towards == tinted


def test_arrow_points_along_word_from_the_contact_centroid(
    tilted_camera: PinholeCamera, render_sheet: Callable, make_sheet: Callable
) -> None:
    frame = render_sheet(tilted_camera, make_sheet(amplitude=0.0015, normal=0.6))
    cloth_state = PerceptionPipeline(tilted_camera, None, 19600).perceive(frame.rgb, frame.depth)
    picture = draw_cloth_state(frame.rgb, cloth_state, tilted_camera)
    rows, columns = np.nonzero(cloth_state.contact_mask)
    start = cloth_state.grid.to_table([columns.mean(), rows.mean()])[0]
    middle = start + 0.4 * ARROW_M * cloth_state.word
    (pixel,), _ = tilted_camera.project([(*middle, 0.0)])
    column, row = np.rint(pixel).astype(int)
    np.testing.assert_allclose(picture[row, column], ARROW, atol=12)


def test_every_kind_of_percept_can_be_drawn(
    tilted_camera: PinholeCamera, render_sheet: Callable, make_sheet: Callable
) -> None:
    perceiver = PerceptionPipeline(tilted_camera)
    for sheet in (None, make_sheet(), make_sheet(rest=0.2), make_sheet(centre=(0.7, 0.0), amplitude=0.003)):
        frame = render_sheet(tilted_camera, sheet)
        cloth_state = perceiver.perceive(frame.rgb, frame.depth)
        assert math.isnan(cloth_state.contact_portion)
        assert draw_cloth_state(frame.rgb, cloth_state, tilted_camera).shape == (240, 320, 3)


def test_wrong_input_is_refused(tilted_camera: PinholeCamera, render_sheet: Callable) -> None:
    frame = render_sheet(tilted_camera, None)
    cloth_state = PerceptionPipeline(tilted_camera).perceive(frame.rgb, frame.depth)
    with pytest.raises(PerceptionError, match="rgb has shape"):
        draw_cloth_state(frame.rgb[:10], cloth_state, tilted_camera)
    with pytest.raises(PerceptionError, match="scale is 0"):
        draw_cloth_state(frame.rgb, cloth_state, tilted_camera, scale=0)
