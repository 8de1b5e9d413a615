"""WORD on table views of known wrinkles (the camera is left out; test_percept has it)."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from perception.descriptor import axial_mean
from perception.errors import PerceptionError
from perception.tableview import ClothView
from perception.word import THESIS, WordConfig, WordDescriptor, compute_word, wrinkle_sums

CONFIG = WordConfig()


def striped_view(
    normal: float,
    *,
    depth: float = 0.1,
    wavelength_mm: float = 58.0,
    phase: float = 0.4,
    noise: float = 0.0,
    side: int = 140,
) -> ClothView:
    """A square cloth on a white table, with sine stripes whose perpendicular is at ``normal`` rad from +x (y up)."""
    shape = (side + 20, side + 20)
    row, column = np.mgrid[: shape[0], : shape[1]]
    along = (column * math.cos(normal) - row * math.sin(normal)) * 2.5
    shade = 1 + depth * np.sin(2 * math.pi * along / wavelength_mm + phase)
    cloth = np.zeros(shape, dtype=bool)
    cloth[10:-10, 10:-10] = True
    rgb = np.where(cloth[..., None], np.array([40.0, 90.0, 200.0]) * shade[..., None], 205.0)
    rgb += np.random.default_rng(1).normal(0, noise, rgb.shape) if noise else 0
    return ClothView(
        rgb=np.clip(np.rint(rgb), 0, 255).astype(np.uint8),
        cloth=cloth,
        contact=cloth.copy(),
        height=np.full(shape, 0.004, dtype=np.float32),
        mm_per_px=2.5,
    )


def with_masks(view: ClothView, cloth: np.ndarray, contact: np.ndarray) -> ClothView:
    return ClothView(rgb=view.rgb, cloth=cloth, contact=contact, height=view.height, mm_per_px=view.mm_per_px)


def axis_error(vector: np.ndarray, normal: float) -> float:
    """Degrees between two axes, 0..90."""
    angle = math.degrees(math.atan2(vector[1], vector[0]) - normal) % 180
    return min(angle, 180 - angle)


@pytest.mark.parametrize("wavelength_mm", [45.0, 58.0, 80.0])
def test_axial_direction_is_right_for_all_angles(wavelength_mm: float) -> None:
    for normal in np.linspace(-math.pi / 2, math.pi / 2, 24, endpoint=False):
        word = compute_word(striped_view(normal, wavelength_mm=wavelength_mm), CONFIG)
        assert axis_error(word.axial, normal) < 6.0
        assert word.coherence > 0.4
        assert word.strength == pytest.approx(0.1 * 2 / math.pi, rel=0.45)


def test_word_is_right_where_eq_3_3_is_unbiased_and_leans_to_x_elsewhere() -> None:
    assert axis_error(compute_word(striped_view(0.0), CONFIG).direction, 0.0) < 6.0
    for normal in np.radians([30.0, 50.0, 65.0, -30.0, -50.0]):
        word = compute_word(striped_view(normal), CONFIG)
        assert axis_error(word.direction, normal) < 30.0
        assert word.direction[0] > word.axial[0]


def test_strongest_weight_is_the_orientation_of_the_wrinkles() -> None:
    for index, normal in enumerate(CONFIG.normals):
        word = compute_word(striped_view(math.atan2(normal[1], normal[0])), CONFIG)
        assert int(np.argmax(word.weights)) == index
        assert word.weights.max() == 1.0


def test_perpendiculars_are_perpendicular_and_in_the_half_plane() -> None:
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
def test_any_image_gives_a_unit_vector_in_the_half_plane_or_nothing(rgb: np.ndarray, cloth: np.ndarray) -> None:
    view = ClothView(rgb=rgb, cloth=cloth, contact=cloth, height=np.zeros((40, 50), np.float32), mm_per_px=2.5)
    for config in (WordConfig(erosion_mm=0, min_area_mm2=0), THESIS):
        word = compute_word(view, config)
        for vector in (word.direction, word.axial):
            assert np.isfinite(vector).all()
            assert vector[0] >= 0
            assert np.linalg.norm(vector) == pytest.approx(1.0 if word.strength > 0 else 0.0)
        assert 0 <= word.coherence <= 1 + 1e-9


def test_flat_cloth_with_sensor_noise_has_no_direction() -> None:
    for noise in (0.0, 3.0, 6.0):
        word = compute_word(striped_view(0.3, depth=0.0, noise=noise), CONFIG)
        assert not word.direction.any()
        assert not word.axial.any()
        assert word.strength == word.coherence == 0.0
        assert not word.weights.any()


def test_noise_hardly_turns_a_wrinkle() -> None:
    clean = compute_word(striped_view(0.5), CONFIG)
    noisy = compute_word(striped_view(0.5, noise=6.0), CONFIG)
    assert axis_error(noisy.axial, math.atan2(clean.axial[1], clean.axial[0])) < 2.0


def test_the_outline_of_the_cloth_is_not_a_wrinkle() -> None:
    view = striped_view(0.0, depth=0.0)
    cloth = view.cloth.copy()
    cloth[:, 80:] = False
    rgb = np.where(cloth[..., None], view.rgb, 205).astype(np.uint8)
    half = ClothView(rgb=rgb, cloth=cloth, contact=cloth, height=view.height, mm_per_px=2.5)
    assert compute_word(half, CONFIG).strength == 0.0
    assert compute_word(half, WordConfig(fill=False, erosion_mm=0)).strength > 5 * CONFIG.noise_floor


def test_turning_the_table_by_90_degrees_rolls_the_weights() -> None:
    view = striped_view(0.35, noise=3.0)
    turned = ClothView(
        rgb=np.ascontiguousarray(np.rot90(view.rgb)),
        cloth=np.ascontiguousarray(np.rot90(view.cloth)),
        contact=np.ascontiguousarray(np.rot90(view.contact)),
        height=np.ascontiguousarray(np.rot90(view.height)),
        mm_per_px=2.5,
    )
    one, other = compute_word(view, CONFIG), compute_word(turned, CONFIG)
    np.testing.assert_allclose(other.weights, np.roll(one.weights, 4), atol=1e-3)
    assert axis_error(other.axial, math.atan2(one.axial[1], one.axial[0]) + math.pi / 2) < 0.1


def test_mirroring_y_mirrors_the_axis() -> None:
    up, down = compute_word(striped_view(0.6), CONFIG), compute_word(striped_view(-0.6), CONFIG)
    assert axis_error(up.axial, -math.atan2(down.axial[1], down.axial[0])) < 2.0


@pytest.mark.parametrize("exposure", [0.5, 0.8, 1.1])
def test_exposure_cancels(exposure: float) -> None:
    view = striped_view(0.7)
    rgb = np.clip(view.rgb * exposure, 0, 255).astype(np.uint8)
    other = ClothView(rgb=rgb, cloth=view.cloth, contact=view.contact, height=view.height, mm_per_px=2.5)
    one, two = compute_word(view, CONFIG), compute_word(other, CONFIG)
    np.testing.assert_allclose(two.direction, one.direction, atol=0.02)
    assert two.strength == pytest.approx(one.strength, rel=0.05)


def test_wrinkles_far_from_contact_or_high_up_do_not_count() -> None:
    view = striped_view(0.0)
    assert compute_word(with_masks(view, view.cloth, np.zeros_like(view.contact)), CONFIG).strength == 0.0
    raised = ClothView(
        rgb=view.rgb, cloth=view.cloth, contact=view.contact, height=view.height + 0.05, mm_per_px=view.mm_per_px
    )
    assert compute_word(raised, CONFIG).strength == 0.0
    # Contact only in the valleys: the flanks, within 25 mm, still do.
    valleys = view.contact & (np.arange(view.contact.shape[1]) % 23 < 6)[None, :]
    assert compute_word(with_masks(view, view.cloth, valleys), CONFIG).strength > 0.04


def test_too_little_cloth_has_no_direction() -> None:
    assert compute_word(striped_view(0.0, side=20), CONFIG).strength == 0.0
    none = np.zeros((30, 30), dtype=bool)
    empty = ClothView(
        rgb=np.zeros((30, 30, 3), np.uint8),
        cloth=none,
        contact=none,
        height=np.zeros((30, 30), np.float32),
        mm_per_px=2.5,
    )
    for config in (CONFIG, THESIS):
        assert wrinkle_sums(empty, config)[1] == 0
        assert not compute_word(empty, config).direction.any()


def test_thesis_preset_is_the_parameters_of_figure_3_1_in_pixels() -> None:
    for mm_per_px in (1.0, 2.5):
        params = THESIS.gabor(mm_per_px)
        assert (params.wavelength, params.sigma, params.gamma, params.psi, params.size) == (8.0, 4.0, 0.1, 10.0, 12)
    assert THESIS.orientations == 8


def test_thesis_preset_answers_to_a_flat_cloth_by_the_sums_of_its_kernels() -> None:
    # Eq. 3-1 with psi = 10 does not sum to zero, so a cloth without any wrinkle gets weights, and the lean to +x.
    view = striped_view(0.0, depth=0.0)
    cloth = ClothView(
        rgb=np.full_like(view.rgb, 120), cloth=view.cloth, contact=view.contact, height=view.height, mm_per_px=2.5
    )
    theta = [-math.atan2(y, x) for x, y in THESIS.normals]
    sums = [abs(cv2.getGaborKernel((12, 12), 4, t, 8, 0.1, 10 - math.pi / 2, cv2.CV_64F).sum()) for t in theta]
    flat = compute_word(cloth, THESIS)
    np.testing.assert_allclose(flat.weights, np.array(sums) / max(sums), atol=1e-4)
    assert flat.direction[0] > 0.9


def test_millimetres_become_pixels() -> None:
    fine, coarse = CONFIG.gabor(2.5), CONFIG.gabor(5.0)
    assert fine.wavelength == pytest.approx(58 / 2.5)
    assert coarse.wavelength == pytest.approx(fine.wavelength / 2)
    assert coarse.sigma == pytest.approx(fine.sigma / 2)


@given(angles=st.lists(st.floats(-1.5, 1.5), min_size=1, max_size=6))
def test_axial_mean_does_not_care_for_signs(angles: list[float]) -> None:
    vectors = np.column_stack([np.cos(angles), np.sin(angles)])
    weights = np.arange(1.0, len(angles) + 1)
    one, coherence = axial_mean(weights, vectors)
    other, same = axial_mean(weights, -vectors)
    np.testing.assert_allclose(one, other)
    assert coherence == pytest.approx(same)
    if len(angles) == 1:
        np.testing.assert_allclose(one, vectors[0], atol=1e-9)
        assert coherence == pytest.approx(1.0)


def test_equal_weights_have_no_coherence() -> None:
    assert axial_mean(np.ones(8), CONFIG.normals)[1] < 1e-9


def test_descriptor_is_the_direction() -> None:
    view = striped_view(0.4)
    np.testing.assert_array_equal(WordDescriptor().describe(view), compute_word(view, CONFIG).direction)


def test_wrong_settings_are_refused() -> None:
    with pytest.raises(PerceptionError, match="orientations is 1"):
        WordConfig(orientations=1)
    with pytest.raises(PerceptionError, match="must be positive"):
        WordConfig(sigma=0)
    with pytest.raises(PerceptionError, match="same pixels"):
        with_masks(striped_view(0.0), np.ones((3, 3), bool), np.ones((3, 3), bool))
