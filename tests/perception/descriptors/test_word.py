"""WORD on table views of known wrinkles (the camera is left out; test_percept has it)."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from layflat.perception.camera.rectified_view import ClothView
from layflat.perception.descriptors.base import axial_mean, filter_angles
from layflat.perception.descriptors.gabor import gabor_bank
from layflat.perception.descriptors.preprocess import relative_brightness
from layflat.perception.descriptors.word import (
    AXIAL_CONFIG,
    THESIS_CONFIG,
    WordConfig,
    WordDescriptor,
    compute_word,
    orientation_responses,
    word_axial,
)
from layflat.tests.perception.factories import CLOTH_RGB, axis_error, finer, striped_view


@pytest.mark.parametrize("wavelength_mm", [45.0, 58.0, 80.0])
@pytest.mark.parametrize("channel", [{"depth": 0.05}, {"depth": 0.0, "slope": 0.2}], ids=["light", "relief"])
def test_axial_direction_is_right_for_all_angles_by_light_alone_and_by_relief_alone(wavelength_mm, channel):
    for normal in np.linspace(-math.pi / 2, math.pi / 2, 24, endpoint=False):
        word = compute_word(striped_view(normal, wavelength_mm=wavelength_mm, **channel), AXIAL_CONFIG)
        assert axis_error(word.axial, normal) < 1.0
        assert word.coherence > 0.4
        if wavelength_mm == 58.0:  # nearly the kernel's: gain 1
            assert word.strength == pytest.approx(max(channel.values()) / math.sqrt(2), rel=0.15)


def test_one_channel_sees_what_the_other_is_blind_to():
    lit, raised = striped_view(0.5, depth=0.055), striped_view(0.5 - math.pi / 2, depth=0.0, slope=0.055)
    # Equal wrinkles across each other, each seen by one channel only: no axis is preferred.
    assert compute_word(replace(lit, height=raised.height), AXIAL_CONFIG).coherence < 0.12
    assert compute_word(lit, AXIAL_CONFIG).coherence > 0.5


def test_algorithm_1_is_what_its_lines_say():
    """Eq. 3-1 to 3-3 done with OpenCV's own kernel and filter on the whole picture."""
    view = striped_view(0.7, noise=3.0)
    config = replace(THESIS_CONFIG, zero_mean=False)
    scale = config.wavelength_mm / view.mm_per_px / 8.0
    size = 2 * (round(12 * scale) // 2) + 1
    image = relative_brightness(view.rgb, view.cloth)
    sums, perpendiculars = [], []
    for i in range(8):
        wrinkle = i * math.pi / 8
        # theta is the normal of the stripes with y down (of the wrinkles along x the one towards +y, as in Eq. 3-3);
        # OpenCV has a cosine where Eq. 3-1 has a sine.
        theta = math.pi / 2 - wrinkle if i else -math.pi / 2
        kernel = cv2.getGaborKernel((size, size), 4 * scale, theta, 8 * scale, 0.1, 10 - math.pi / 2, cv2.CV_32F)
        answer = cv2.filter2D(image, cv2.CV_32F, kernel, borderType=cv2.BORDER_REPLICATE)
        sums.append(float(np.maximum(answer, 0)[view.cloth & view.contact].sum()))
        perpendiculars.append((math.sin(wrinkle), -math.cos(wrinkle)) if i else (0.0, 1.0))
    weights = np.array(sums) / max(sums)
    total = weights @ np.array(perpendiculars)
    word = compute_word(view, config)
    np.testing.assert_allclose(word.weights, weights, atol=1e-4)
    np.testing.assert_allclose(word.direction, total / np.linalg.norm(total), atol=1e-4)


def test_fast_responses_are_those_of_one_filter2d_per_orientation():
    for view in (striped_view(0.7, slope=0.1, noise=3.0), striped_view(-1.2, shape=(90, 90), noise=3.0)):
        image = relative_brightness(view.rgb, view.cloth)
        plain = [
            np.maximum(cv2.filter2D(image, cv2.CV_32F, kernel, borderType=cv2.BORDER_REPLICATE), 0)[view.cloth].mean()
            for kernel in gabor_bank(THESIS_CONFIG.gabor(view.mm_per_px), filter_angles(8))
        ]
        np.testing.assert_allclose(orientation_responses(view, THESIS_CONFIG)[0], plain, rtol=1e-5)


def test_eq_3_3_is_right_for_wrinkles_along_y_and_leans_to_x_elsewhere():
    assert axis_error(compute_word(striped_view(0.0), AXIAL_CONFIG).direction, 0.0) < 2.0
    for normal in np.radians([50.0, 65.0, 80.0, -30.0, -50.0, -65.0]):
        word = compute_word(striped_view(normal), AXIAL_CONFIG)
        assert word.direction[0] > word.axial[0] + 0.02
        assert axis_error(word.axial, normal) < 1.0 < 2.0 < axis_error(word.direction, normal)


def test_strongest_weight_is_the_orientation_of_the_wrinkles():
    for config in (THESIS_CONFIG, AXIAL_CONFIG):
        for index, normal in enumerate(config.normals):
            word = compute_word(striped_view(math.atan2(normal[1], normal[0])), replace(config, fill=True))
            assert int(np.argmax(word.weights)) == index
            assert word.weights.max() == 1.0


def test_perpendiculars_are_perpendicular_and_in_the_half_plane():
    for n in (2, 5, 8, 13):
        normals = WordConfig(orientations=n).normals
        theta = np.arange(n) * math.pi / n
        wrinkles = np.column_stack([np.cos(theta), np.sin(theta)])
        np.testing.assert_allclose(np.sum(normals * wrinkles, axis=1), 0.0, atol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
        assert (normals[:, 0] >= 0).all()


@settings(max_examples=30)
@given(
    rgb=arrays(np.uint8, (40, 50, 3)),
    cloth=arrays(np.bool_, (40, 50), elements=st.sampled_from([True, True, True, False])),
)
def test_any_image_gives_a_unit_vector_in_the_half_plane_or_nothing(rgb, cloth):
    view = ClothView(rgb=rgb, cloth=cloth, contact=cloth, height=np.zeros((40, 50), np.float32), mm_per_px=2.5)
    for config in (replace(AXIAL_CONFIG, erosion_mm=0, min_area_mm2=0), replace(THESIS_CONFIG, min_area_mm2=0)):
        word = compute_word(view, config)
        for vector in (word.direction, word.axial):
            assert np.isfinite(vector).all()
            assert vector[0] >= 0
            assert np.linalg.norm(vector) == pytest.approx(1.0 if word.strength > 0 else 0.0)
        assert 0 <= word.coherence <= 1 + 1e-9


@pytest.mark.parametrize("config", [THESIS_CONFIG, AXIAL_CONFIG])
@pytest.mark.parametrize("noise", [0.0, 3.0, 6.0])
def test_flat_cloth_with_sensor_noise_has_no_direction(config, noise):
    view = striped_view(0.3, depth=0.0, noise=noise)
    word = compute_word(view, config)
    assert not any(array.any() for array in (word.direction, word.axial, word.weights))
    assert word.strength == word.coherence == 0.0
    # Eq. 3-1 with the parameters of figure 3-1 answers to a flat cloth: why zero_mean is the default.
    assert compute_word(view, replace(THESIS_CONFIG, zero_mean=False)).strength > 0.1


def test_noise_hardly_turns_a_wrinkle():
    clean, noisy = (compute_word(striped_view(0.5, noise=noise), AXIAL_CONFIG).axial for noise in (0.0, 6.0))
    assert axis_error(noisy, clean) < 2.0


def test_the_outline_of_the_cloth_is_a_wrinkle_to_the_letter_only():
    faint = striped_view(0.6, depth=0.03)
    narrow = faint.cloth & (np.arange(faint.cloth.shape[1]) < 80)
    rgb, bare_rgb = (np.where(narrow[..., None], inside, 205).astype(np.uint8) for inside in (faint.rgb, CLOTH_RGB))
    view = replace(faint, rgb=rgb, cloth=narrow, contact=narrow)
    assert axis_error(compute_word(view, AXIAL_CONFIG).axial, 0.6) < 2.0
    letter = compute_word(view, THESIS_CONFIG)
    assert letter.strength < 0.03
    assert axis_error(letter.axial, 0.0) < 10.0  # its two long edges run along y
    bare = replace(view, rgb=bare_rgb)
    assert compute_word(bare, THESIS_CONFIG).strength == compute_word(bare, AXIAL_CONFIG).strength == 0.0


def test_turning_the_table_by_90_degrees_rolls_the_weights():
    view = striped_view(0.35, noise=3.0)
    arrays = {name: getattr(view, name) for name in ("rgb", "cloth", "contact", "height")}
    turned = replace(view, **{name: np.ascontiguousarray(np.rot90(array)) for name, array in arrays.items()})
    one, other = compute_word(view, AXIAL_CONFIG), compute_word(turned, AXIAL_CONFIG)
    np.testing.assert_allclose(other.weights, np.roll(one.weights, 4), atol=2e-3)
    assert axis_error(other.axial, math.atan2(one.axial[1], one.axial[0]) + math.pi / 2) < 0.1


def test_wrinkles_far_from_contact_or_high_up_do_not_count():
    view = striped_view(0.0)
    nothing = replace(view, contact=np.zeros_like(view.contact))
    for config, hidden in (
        (AXIAL_CONFIG, nothing),
        (THESIS_CONFIG, nothing),
        (AXIAL_CONFIG, striped_view(rest_m=0.06)),
    ):
        assert compute_word(hidden, config).strength == 0.0
    # Contact only in the valleys: the flanks, within 25 mm, still do.
    valleys = view.contact & (np.arange(view.contact.shape[1]) % 23 < 6)
    assert compute_word(replace(view, contact=valleys), AXIAL_CONFIG).strength > 0.04


def test_the_edge_of_a_shadow_turns_word_axial_little():
    """Half of the cloth is half as bright; the edge runs along x, the wrinkles' perpendicular lies at 20 degrees."""
    view = striped_view(0.35, depth=0.06, slope=0.15)
    shade = np.where(np.arange(view.cloth.shape[0]) < 80, 0.5, 1.0)[:, None, None]
    shaded = replace(view, rgb=np.rint(view.rgb * shade).astype(np.uint8))
    cut = axis_error(compute_word(shaded, AXIAL_CONFIG).axial, 0.35)
    whole = axis_error(compute_word(shaded, replace(AXIAL_CONFIG, max_contrast=math.inf)).axial, 0.35)
    assert cut < 3.0
    assert cut < whole / 2


def test_a_wrinkle_on_a_small_part_of_a_flat_noisy_cloth_is_seen():
    flat, wrinkled = striped_view(0.6, depth=0.0, noise=3.0), striped_view(0.6, depth=0.06, noise=3.0)
    patch = np.zeros_like(flat.cloth)
    patch[80:130, 85:135] = True  # an eighth of the cloth
    local = replace(flat, rgb=np.where(patch[..., None], wrinkled.rgb, flat.rgb))
    assert compute_word(flat, AXIAL_CONFIG).strength == 0.0
    word = compute_word(local, AXIAL_CONFIG)
    assert axis_error(word.axial, 0.6) < 10.0
    assert word.strength > 2 * compute_word(local, replace(AXIAL_CONFIG, rms=False)).strength


def test_too_little_cloth_has_no_direction():
    assert compute_word(striped_view(0.0, shape=(20, 20)), AXIAL_CONFIG).strength == 0.0
    view = striped_view()
    none = np.zeros_like(view.cloth)
    empty = replace(view, cloth=none, contact=none)
    for config in (AXIAL_CONFIG, THESIS_CONFIG, replace(THESIS_CONFIG, min_area_mm2=0)):
        assert orientation_responses(empty, config)[1] == 0
        assert not compute_word(empty, config).direction.any()


def test_the_defaults_are_the_parameters_of_figure_3_1_where_its_wavelength_has_8_pixels():
    params = THESIS_CONFIG.gabor(THESIS_CONFIG.wavelength_mm / 8)
    assert (params.wavelength, params.sigma, params.gamma, params.psi, params.size) == (8.0, 4.0, 0.1, 10.0, 12)
    assert THESIS_CONFIG.orientations == 8
    assert WordConfig() == THESIS_CONFIG == WordDescriptor().config


@pytest.mark.parametrize("descriptor", [WordDescriptor(), word_axial()])
def test_a_finer_camera_sees_the_same(descriptor):
    """The kernel is a length on the cloth: twice the pixels give the same direction and strength."""
    view = striped_view(0.6, slope=0.15)
    one, two = descriptor.direction(view), descriptor.direction(finer(view))
    np.testing.assert_allclose(two.vector, one.vector, atol=0.03)
    assert two.strength == pytest.approx(one.strength, rel=0.05)


@given(angles=st.lists(st.floats(-1.5, 1.5), min_size=1, max_size=6))
def test_axial_mean_does_not_care_for_signs(angles):
    vectors = np.column_stack([np.cos(angles), np.sin(angles)])
    weights = np.arange(1.0, len(angles) + 1)
    assert axial_mean(np.ones(8), AXIAL_CONFIG.normals)[1] < 1e-9
    one, coherence = axial_mean(weights, vectors)
    other, same = axial_mean(weights, -vectors)
    np.testing.assert_allclose(one, other)
    assert coherence == pytest.approx(same)
    if len(angles) == 1:
        np.testing.assert_allclose(one, vectors[0], atol=1e-9)
        assert coherence == pytest.approx(1.0)


def test_descriptor_is_the_direction():
    view = striped_view(0.4)
    np.testing.assert_array_equal(WordDescriptor().describe(view), compute_word(view, THESIS_CONFIG).direction)
    np.testing.assert_array_equal(word_axial().describe(view), compute_word(view, AXIAL_CONFIG).axial)
