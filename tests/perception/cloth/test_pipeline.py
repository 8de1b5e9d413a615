"""From a camera's RGB-D frame to a ClothState, on rendered frames of known sheets."""

from __future__ import annotations

import math

import numpy as np
import pytest

from layflat.perception.camera.table_grid import TableGrid
from layflat.perception.cloth.pipeline import ClothState, PerceptionConfig, PerceptionPipeline
from layflat.perception.descriptors.word import WordDescriptor
from layflat.perception.synthetic_sheet import Light, RenderConfig, SyntheticSheet, render_sheet
from layflat.tests.perception.factories import TILTED, axis_error, render, wrinkled_sheet

FLAT = round(0.35**2 / 0.0025**2)
PIPELINE = PerceptionPipeline(TILTED, PerceptionConfig(), FLAT)


def perceive(rendered: dict | None = None, by: PerceptionPipeline = PIPELINE, **sheet) -> ClothState:
    """Render a sheet (keywords of ``wrinkled_sheet``; those of ``render`` in ``rendered``) and perceive it."""
    frame = render(wrinkled_sheet(**sheet), **(rendered or {}))
    return by.perceive(frame.rgb, frame.depth)


def assert_no_direction(state: ClothState):
    assert not state.word.any()
    assert state.strength == state.coherence == 0.0


@pytest.mark.parametrize("rendered", [{}, {"seed": 3, "missing": 0.03}, {"seed": 4, "exposure": 0.6}])
def test_flat_cloth_is_all_contact_and_has_no_direction(rendered):
    state = perceive(rendered)
    assert state.cloth_pixels == pytest.approx(FLAT, rel=0.02)
    assert state.contact_portion == pytest.approx(1.0, abs=0.02)
    assert_no_direction(state)
    assert not state.out_of_view


@pytest.mark.parametrize("depth_noise_m", [0.0, 0.001, 0.004, 0.008])
@pytest.mark.parametrize("exposure", [0.25, 1.4])
def test_noise_is_no_direction_on_any_sensor(depth_noise_m, exposure):
    for seed in range(3):
        config = RenderConfig(light=Light(exposure=exposure), rgb_noise=4.0, depth_noise_m=depth_noise_m, seed=seed)
        frame = render_sheet(TILTED, SyntheticSheet(size=(0.275, 0.215)), config)
        assert PIPELINE.perceive(frame.rgb, frame.depth).strength == 0.0


def test_flat_count_does_not_depend_on_place_or_turn():
    places = [(0.25, 0.0), (0.1, 0.05), (0.42, -0.04)]
    counts = [perceive(centre=centre, yaw=yaw).contact_pixels for centre in places for yaw in (0.0, 0.3)]
    assert max(counts) / min(counts) < 1.02


def test_a_lifted_part_is_not_contact():
    # Rises from x = 0.25 at 1:2; it passes the threshold of 8 mm 8 mm farther on: half the cloth and 8 mm of 350.
    state = perceive({"seed": 0, "missing": 0.02}, lift_x=0.25)
    assert state.contact_portion == pytest.approx(0.5 + 0.008 / 0.35, abs=0.03)
    assert state.cloth_pixels > state.contact_pixels


@pytest.mark.parametrize("stretch", [1.0, 1.01, 1.02])
def test_stretch_is_not_taken_for_contact(stretch):
    """Stretched along both sides, all of it lying or with one end lifted: the same share lies at any size."""
    known = PIPELINE.with_flat_pixels(perceive({"seed": 0}).cloth_pixels)  # P_flat through the same noise
    side = 0.35 * stretch
    assert perceive({"seed": 1}, by=known, size=(side, side)).contact_portion == pytest.approx(1.0, abs=0.01)
    for lift_x in (0.3, 0.35):
        # From the back edge to where the lift of 1:2 passes 8 mm, of the whole side.
        share = (side / 2 + lift_x - 0.25 + 0.008) / side
        lifted = perceive({"seed": 2}, by=known, size=(side, side), lift_x=lift_x)
        assert lifted.contact_portion == pytest.approx(share, abs=0.02)


def test_a_cloth_in_the_air_has_no_contact_and_no_direction():
    state = perceive(rest=0.15, amplitude=0.004)
    assert state.contact_pixels == 0
    assert state.contact_portion == 0.0
    assert_no_direction(state)


def test_without_cloth_everything_is_zero_and_out_of_view():
    frame = render(None, seed=0, missing=0.02)
    state = PIPELINE.perceive(frame.rgb, frame.depth)
    assert state.cloth_pixels == state.contact_pixels == state.contact_portion == 0
    assert_no_direction(state)
    assert state.out_of_view
    assert state.free_edge_m is None


@pytest.mark.parametrize("seed", [5, 6])
def test_missing_depth_hardly_changes_contact(seed):
    sheet = {"lift_x": 0.3, "amplitude": 0.001}
    whole = perceive({"seed": 5}, **sheet).contact_pixels
    assert perceive({"seed": seed, "missing": 0.03}, **sheet).contact_pixels == pytest.approx(whole, rel=0.01)


def test_contact_grows_with_the_threshold():
    heights = (0.004, 0.006, 0.008, 0.012, 0.02)
    pipelines = [PerceptionPipeline(TILTED, PerceptionConfig(contact_height_m=height)) for height in heights]
    counts = [perceive({"seed": 2}, by=pipeline, amplitude=0.005).contact_pixels for pipeline in pipelines]
    assert counts == sorted(counts)
    assert counts[0] < counts[2] < counts[-1]


@pytest.mark.parametrize("degrees", [-80, -65, -15, 0, 20, 45, 70, 85])
def test_wrinkles_across_the_light_give_their_axis(degrees):
    normal = math.radians(degrees)
    state = perceive({"seed": 7, "missing": 0.02}, normal=normal, amplitude=0.002)
    assert axis_error(state.word, normal) < 3.0
    assert state.word[0] >= 0
    assert np.linalg.norm(state.word) == pytest.approx(1.0)
    assert state.coherence > 0.3


@pytest.mark.parametrize(("azimuth", "elevation"), [(25.0, 20.0), (25.0, 45.0), (0.0, 90.0)])
def test_a_light_along_the_wrinkles_or_straight_above_hides_nothing(azimuth, elevation):
    normal = math.radians(azimuth + 90.0)
    light = {"azimuth_deg": azimuth, "elevation_deg": elevation}
    assert axis_error(perceive({"seed": 7, **light}, normal=normal, amplitude=0.002).word, normal) < 8.0


def test_deeper_wrinkles_are_stronger():
    strengths = [perceive(amplitude=a).strength for a in (0.0, 0.0015, 0.003, 0.0045)]
    assert strengths == sorted(strengths)
    assert strengths[3] == pytest.approx(1.5 * strengths[2], rel=0.2)


def test_out_of_view_at_the_image_and_at_the_grid():
    assert perceive(centre=(0.65, 0.0)).out_of_view
    assert perceive(centre=(0.25, -0.35)).out_of_view
    small = PerceptionPipeline(TILTED, PerceptionConfig(grid=TableGrid(x_max=0.35)), FLAT)
    assert perceive(by=small).out_of_view
    assert not perceive(by=small, centre=(0.1, 0.0)).out_of_view
    lifted = perceive(size=(0.2, 1.2), rest=0.2)  # a lifted part may leave the image
    assert lifted.contact_pixels == 0
    assert not lifted.out_of_view


def test_cloth_that_hovers_near_the_table_is_out_of_view_at_a_border_although_it_has_no_contact():
    small = PerceptionPipeline(TILTED, PerceptionConfig(grid=TableGrid(x_max=0.35)), FLAT)
    for by, centre in ((small, (0.25, 0.0)), (PIPELINE, (0.65, 0.0))):  # the grid's border, the image's
        near, far = (perceive(by=by, centre=centre, rest=height) for height in (0.02, 0.06))
        assert near.out_of_view
        assert near.contact_pixels == far.contact_pixels == 0
        assert not far.out_of_view


def test_the_descriptor_can_be_chosen():
    letter = PerceptionPipeline(TILTED, PerceptionConfig(descriptor=WordDescriptor()), FLAT)
    sheet = {"amplitude": 0.002, "normal": 1.2}
    frame = render(wrinkled_sheet(**sheet))
    state = perceive(by=letter, **sheet)
    np.testing.assert_array_equal(state.word, WordDescriptor().describe(letter.cloth_view(frame.rgb, frame.depth)))
    assert state.word[0] > perceive(**sheet).word[0] + 0.1  # Eq. 3-3 leans to +x


def test_flat_pixels_are_needed_for_the_portion_only():
    blank = PerceptionPipeline(TILTED)
    state = perceive(by=blank)
    assert math.isnan(state.contact_portion)
    assert perceive(by=blank.with_flat_pixels(state.cloth_pixels)).contact_portion == 1.0
    assert blank.flat_pixels is None


def test_states_are_read_only_and_checked():
    state = perceive()
    for array in (state.cloth_mask, state.contact_mask, state.word, state.free_edge_m):
        assert not array.flags.writeable
