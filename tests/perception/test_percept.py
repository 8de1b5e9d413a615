"""The whole way from a camera's RGB-D frame to a ClothState, on drawn frames of known sheets."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.camera.table_grid import TableGrid
from layflat.perception.cloth.pipeline import ClothState, PerceptionConfig, PerceptionPipeline
from layflat.perception.descriptors.word import WordDescriptor
from layflat.perception.errors import PerceptionError
from layflat.perception.synthetic_sheet import Light, RenderConfig, SyntheticSheet, render_sheet

FLAT = round(0.35**2 / 0.0025**2)


@pytest.fixture(scope="module")
def perceiver(tilted_camera: PinholeCamera) -> PerceptionPipeline:
    return PerceptionPipeline(tilted_camera, PerceptionConfig(), FLAT)


@pytest.fixture(scope="module")
def look(perceiver: PerceptionPipeline, render_sheet: Callable, make_sheet: Callable) -> Callable[..., ClothState]:
    """Draw a sheet (keywords of SyntheticSheet; those of draw in ``drawn``) and perceive it."""

    def see(drawn: dict | None = None, by: PerceptionPipeline = perceiver, **sheet: object) -> ClothState:
        frame = render_sheet(by.camera, make_sheet(**sheet), **(drawn or {}))
        return by.perceive(frame.rgb, frame.depth)

    return see


def axis_degrees(vector: np.ndarray, normal: float) -> float:
    angle = math.degrees(math.atan2(vector[1], vector[0]) - normal) % 180
    return min(angle, 180 - angle)


def test_flat_cloth_is_all_contact_and_has_no_direction(look: Callable[..., ClothState]) -> None:
    for drawn in ({}, {"seed": 3, "missing": 0.03}, {"seed": 4, "exposure": 0.6}):
        cloth_state = look(drawn)
        assert cloth_state.cloth_pixels == pytest.approx(FLAT, rel=0.02)
        assert cloth_state.contact_portion == pytest.approx(1.0, abs=0.02)
        assert not cloth_state.word.any()
        assert cloth_state.strength == 0.0
        assert not cloth_state.out_of_view


@pytest.mark.parametrize("depth_noise_m", [0.0, 0.001, 0.004, 0.008])
@pytest.mark.parametrize("exposure", [0.25, 1.4])
def test_noise_is_no_direction_whatever_the_sensor(
    perceiver: PerceptionPipeline, depth_noise_m: float, exposure: float
) -> None:
    for seed in range(3):
        how = RenderConfig(light=Light(exposure=exposure), rgb_noise=4.0, depth_noise_m=depth_noise_m, seed=seed)
        frame = render_sheet(perceiver.camera, SyntheticSheet(size=(0.275, 0.215)), how)
        assert perceiver.perceive(frame.rgb, frame.depth).strength == 0.0


def test_flat_count_does_not_depend_on_place_or_turn(look: Callable[..., ClothState]) -> None:
    counts = [
        look(centre=centre, yaw=yaw).contact_pixels
        for centre in [(0.25, 0.0), (0.1, 0.05), (0.42, -0.04)]
        for yaw in (0.0, 0.3)
    ]
    assert max(counts) / min(counts) < 1.02


def test_a_lifted_part_is_not_contact(look: Callable[..., ClothState]) -> None:
    # Rises from x = 0.25 at 1:2; it passes the threshold of 8 mm 8 mm farther on: half the cloth and 8 mm of 350.
    cloth_state = look({"seed": 0, "missing": 0.02}, lift_x=0.25)
    assert cloth_state.contact_portion == pytest.approx(0.5 + 0.008 / 0.35, abs=0.03)
    assert cloth_state.cloth_pixels > cloth_state.contact_pixels


@pytest.mark.parametrize("stretch", [1.0, 1.01, 1.02])
def test_stretch_is_not_taken_for_contact(
    perceiver: PerceptionPipeline, look: Callable[..., ClothState], stretch: float
) -> None:
    """Stretched along both sides, all of it lying or with one end lifted: the same share lies, whatever its size."""
    known = perceiver.with_flat_pixels(look({"seed": 0}).cloth_pixels)  # P_flat through the same noise
    side = 0.35 * stretch
    assert look({"seed": 1}, by=known, size=(side, side)).contact_portion == pytest.approx(1.0, abs=0.01)
    for lift_x in (0.3, 0.35):
        # From the back edge to where the lift of 1:2 passes 8 mm, of the whole side.
        share = (side / 2 + lift_x - 0.25 + 0.008) / side
        lifted = look({"seed": 2}, by=known, size=(side, side), lift_x=lift_x)
        assert lifted.contact_portion == pytest.approx(share, abs=0.02)


def test_a_cloth_in_the_air_has_no_contact_and_no_direction(look: Callable[..., ClothState]) -> None:
    cloth_state = look(rest=0.15, amplitude=0.004)
    assert cloth_state.contact_pixels == 0
    assert cloth_state.contact_portion == 0.0
    assert not cloth_state.word.any()
    assert cloth_state.strength == 0.0


def test_without_cloth_there_is_nothing_and_it_is_said(
    perceiver: PerceptionPipeline, tilted_camera: PinholeCamera
) -> None:
    frame = render_sheet(tilted_camera, None, RenderConfig().with_sensor_noise(0))
    cloth_state = perceiver.perceive(frame.rgb, frame.depth)
    assert cloth_state.cloth_pixels == cloth_state.contact_pixels == 0
    assert cloth_state.contact_portion == cloth_state.strength == cloth_state.coherence == 0.0
    assert not cloth_state.word.any()
    assert cloth_state.out_of_view


def test_missing_depth_hardly_changes_contact(look: Callable[..., ClothState]) -> None:
    sheet = {"lift_x": 0.3, "amplitude": 0.001}
    whole = look({"seed": 5}, **sheet).contact_pixels
    for seed in (5, 6):
        assert look({"seed": seed, "missing": 0.03}, **sheet).contact_pixels == pytest.approx(whole, rel=0.01)


def test_contact_grows_with_the_threshold(tilted_camera: PinholeCamera, look: Callable[..., ClothState]) -> None:
    counts = [
        look(
            {"seed": 2},
            by=PerceptionPipeline(tilted_camera, PerceptionConfig(contact_height_m=height)),
            amplitude=0.005,
        ).contact_pixels
        for height in (0.004, 0.006, 0.008, 0.012, 0.02)
    ]
    assert counts == sorted(counts)
    assert counts[0] < counts[2] < counts[-1]


def test_wrinkles_across_the_light_give_their_axis(look: Callable[..., ClothState]) -> None:
    for degrees in (-80, -65, -15, 0, 20, 45, 70, 85):
        normal = math.radians(degrees)
        cloth_state = look({"seed": 7, "missing": 0.02}, normal=normal, amplitude=0.002)
        assert axis_degrees(cloth_state.word, normal) < 3.0
        assert cloth_state.word[0] >= 0
        assert np.linalg.norm(cloth_state.word) == pytest.approx(1.0)
        assert cloth_state.coherence > 0.3


def test_a_light_along_the_wrinkles_or_straight_above_hides_nothing(look: Callable[..., ClothState]) -> None:
    for azimuth, elevation in ((25.0, 20.0), (25.0, 45.0), (0.0, 90.0)):
        cloth_state = look(
            {"seed": 7, "azimuth_deg": azimuth, "elevation_deg": elevation},
            normal=math.radians(azimuth + 90.0),
            amplitude=0.002,
        )
        assert axis_degrees(cloth_state.word, math.radians(azimuth + 90.0)) < 8.0


def test_deeper_wrinkles_are_stronger(look: Callable[..., ClothState]) -> None:
    strengths = [look(amplitude=a).strength for a in (0.0, 0.0015, 0.003, 0.0045)]
    assert strengths == sorted(strengths)
    assert strengths[3] == pytest.approx(1.5 * strengths[2], rel=0.2)


def test_exposure_leaves_word(look: Callable[..., ClothState]) -> None:
    sheet = {"amplitude": 0.002, "normal": 0.5}
    one, two = look(**sheet), look({"exposure": 0.6}, **sheet)
    np.testing.assert_allclose(two.word, one.word, atol=0.02)
    assert two.strength == pytest.approx(one.strength, rel=0.05)


def test_out_of_view_at_the_image_and_at_the_grid(
    tilted_camera: PinholeCamera, look: Callable[..., ClothState]
) -> None:
    assert look(centre=(0.65, 0.0)).out_of_view
    assert look(centre=(0.25, -0.35)).out_of_view
    small = PerceptionPipeline(tilted_camera, PerceptionConfig(grid=TableGrid(x_max=0.35)), FLAT)
    assert look(by=small).out_of_view
    assert not look(by=small, centre=(0.1, 0.0)).out_of_view


def test_a_lifted_part_may_leave_the_image(look: Callable[..., ClothState]) -> None:
    cloth_state = look(centre=(0.25, 0.0), size=(0.2, 1.2), rest=0.2)
    assert cloth_state.contact_pixels == 0
    assert not cloth_state.out_of_view


def test_the_descriptor_can_be_chosen(
    tilted_camera: PinholeCamera, look: Callable[..., ClothState], render_sheet: Callable, make_sheet: Callable
) -> None:
    letter = PerceptionPipeline(tilted_camera, PerceptionConfig(descriptor=WordDescriptor()), FLAT)
    sheet = {"amplitude": 0.002, "normal": 1.2}
    frame = render_sheet(tilted_camera, make_sheet(**sheet))
    view = letter.cloth_view(frame.rgb, frame.depth)
    assert view is not None
    np.testing.assert_array_equal(look(by=letter, **sheet).word, WordDescriptor().describe(view))
    assert look(by=letter, **sheet).word[0] > look(**sheet).word[0] + 0.1  # Eq. 3-3 leans to +x


def test_flat_pixels_are_needed_for_the_portion_only(
    tilted_camera: PinholeCamera, look: Callable[..., ClothState]
) -> None:
    blank = PerceptionPipeline(tilted_camera)
    cloth_state = look(by=blank)
    assert math.isnan(cloth_state.contact_portion)
    known = blank.with_flat_pixels(cloth_state.cloth_pixels)
    assert look(by=known).contact_portion == 1.0
    assert blank.flat_pixels is None
    with pytest.raises(PerceptionError, match="flat_pixels is 0"):
        blank.with_flat_pixels(0)


def test_wrong_frames_are_refused(perceiver: PerceptionPipeline) -> None:
    rgb, depth = np.zeros((240, 320, 3), np.uint8), np.ones((240, 320), np.float32)
    with pytest.raises(PerceptionError, match="rgb is float64"):
        perceiver.perceive(rgb.astype(float), depth)  # type: ignore[arg-type]
    with pytest.raises(PerceptionError, match="rgb is uint8 of shape"):
        perceiver.perceive(rgb[:100], depth)
    with pytest.raises(PerceptionError, match="depth has shape"):
        perceiver.perceive(rgb, depth[:, :10])
    with pytest.raises(PerceptionError, match="must be odd"):
        PerceptionConfig(smoothing_px=4)
    with pytest.raises(PerceptionError, match="below near_height_m"):
        PerceptionConfig(contact_height_m=0.05)


def test_depth_in_millimetres_by_mistake_does_not_pass_for_contact(
    perceiver: PerceptionPipeline, tilted_camera: PinholeCamera, render_sheet: Callable, make_sheet: Callable
) -> None:
    frame = render_sheet(tilted_camera, make_sheet())
    with pytest.raises(PerceptionError, match="metres"):
        perceiver.perceive(frame.rgb, frame.depth * 1000)


def test_percepts_are_read_only_and_checked(look: Callable[..., ClothState]) -> None:
    cloth_state = look()
    for array in (cloth_state.cloth_mask, cloth_state.contact_mask, cloth_state.word):
        assert not array.flags.writeable
    with pytest.raises(PerceptionError, match="word has shape"):
        replace(cloth_state, word=np.zeros(3))
