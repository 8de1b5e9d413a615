"""What every Descriptor owes its callers; all of DESCRIPTORS are tested here."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np
import pytest

from layflat.perception.camera.rectified_view import ClothView
from layflat.perception.descriptors.base import Descriptor
from layflat.perception.descriptors.registry import DESCRIPTORS
from layflat.tests.perception.factories import axis_error, striped_view

LEANING = {"word"}
"""Eq. 3-3 leans to +x by its definition (test_word says how): the right axis and symmetry are not asked of it."""
TOLERANCE_DEG = 3.0
"""Largest error on clear wrinkles over all angles. The worst of HOW is 2.1 (at 80 mm), of HOG 1.6 (at 45 mm: central
differences shorten what lies along the pixels most); noise of 3 grey levels adds at most 0.2."""
every = pytest.mark.parametrize("one", [pytest.param(make(), id=name) for name, make in DESCRIPTORS.items()])
every_axial = pytest.mark.parametrize(
    "one", [pytest.param(make(), id=name) for name, make in DESCRIPTORS.items() if name not in LEANING]
)


def wrinkled_view(normal=0.4, *, depth=0.1, lift_m=0.0, **stripes) -> ClothView:
    """A lit, raised wave of which only the troughs are in contact."""
    view = striped_view(normal, depth=depth, slope=3.25 * depth, rest_m=0.004 + lift_m, **stripes)
    return replace(view, contact=view.cloth & (view.height < 0.008))


def mapped(view: ClothView, change) -> ClothView:
    """The view with all its pixels moved."""
    arrays = {f.name: getattr(view, f.name) for f in fields(view) if f.name != "mm_per_px"}
    return replace(view, **{name: np.ascontiguousarray(change(array)) for name, array in arrays.items()})


def random_view(seed: int, cloth: bool = True) -> ClothView:
    mask = np.zeros((60, 70), dtype=bool)
    mask[8:-8, 8:-8] = cloth
    rgb = np.random.default_rng(seed).integers(0, 255, (60, 70, 3), dtype=np.uint8)
    return ClothView(rgb=rgb, cloth=mask, contact=mask, height=np.zeros((60, 70), np.float32), mm_per_px=2.5)


def angle(direction) -> float:
    return math.atan2(direction.vector[1], direction.vector[0])


def assert_none(direction):
    np.testing.assert_array_equal(direction.vector, np.zeros(2))
    assert direction.coherence == direction.strength == 0.0


def assert_valid(direction):
    """A unit vector in the half-plane, or nothing at all."""
    if direction.strength == 0.0:
        assert_none(direction)
        return
    assert direction.strength > 0
    assert 0 <= direction.coherence <= 1 + 1e-9
    assert direction.vector.shape == (2,)
    assert direction.vector[0] >= 0
    assert np.linalg.norm(direction.vector) == pytest.approx(1.0)


@every
def test_vector_is_finite_repeatable_and_leaves_the_view(one):
    assert isinstance(one, Descriptor)
    assert one.name
    view = random_view(0)
    before = mapped(view, np.copy)
    vector = one.describe(view)
    assert vector.shape == (one.size,)
    assert vector.dtype == np.float64
    assert np.isfinite(vector).all()
    assert one.describe(wrinkled_view()).any()  # noise alone may be nothing to it
    np.testing.assert_array_equal(one.describe(view), vector)
    assert_valid(one.direction(view))
    np.testing.assert_array_equal(one.direction(view).vector, one.direction(view).vector)
    for name in ("rgb", "cloth", "contact", "height"):
        np.testing.assert_array_equal(getattr(view, name), getattr(before, name))


@every
def test_nothing_without_cloth(one):
    view = random_view(0, cloth=False)
    assert not one.describe(view).any()
    assert_none(one.direction(view))


@every
def test_tiny_thin_and_black_cloths_give_no_nan(one):
    base = random_view(1)
    views = [replace(base, rgb=np.zeros_like(base.rgb))]
    for part in (np.s_[20:21, 30:31], np.s_[20:22, 10:60], np.s_[5:55, 30:31]):
        cloth = np.zeros_like(base.cloth)
        cloth[part] = True
        views.append(replace(base, cloth=cloth, contact=cloth))
    for view in views:
        assert np.isfinite(one.describe(view)).all()
        assert_none(one.direction(view))


@every
@pytest.mark.parametrize("noise", [0.0, 3.0, 6.0])
def test_a_flat_cloth_has_no_direction(one, noise):
    assert_none(one.direction(wrinkled_view(depth=0.0, noise=noise)))


@every
def test_a_lifted_cloth_has_no_direction(one):
    assert_none(one.direction(wrinkled_view(lift_m=0.2)))
    assert one.direction(wrinkled_view()).strength > 0  # the same wrinkles on the table have one


@every
@pytest.mark.parametrize("exposure", [0.5, 0.8, 1.1])
def test_exposure_cancels(one, exposure):
    view, other = wrinkled_view(), wrinkled_view(exposure=exposure)
    plain, exposed = one.direction(view), one.direction(other)
    assert axis_error(exposed.vector, plain.vector) < 1.0
    assert exposed.strength == pytest.approx(plain.strength, rel=0.05)
    vector = one.describe(view)
    # At half the exposure grey levels are twice as coarse, which HOG's blocks show most where wrinkles are shallowest.
    assert np.linalg.norm(one.describe(other) - vector) < 0.05 * np.linalg.norm(vector)


@every
def test_the_vector_separates_wrinkles_better_than_noise_blurs_them(one):
    vector, noisy, turned = map(one.describe, (wrinkled_view(), wrinkled_view(noise=3.0), wrinkled_view(1.0)))
    assert np.linalg.norm(noisy - vector) < 0.1 * np.linalg.norm(turned - vector)


@every_axial
@pytest.mark.parametrize("wavelength_mm", [45.0, 58.0, 80.0])
def test_the_axis_is_right_for_all_angles(one, wavelength_mm):
    for normal in np.linspace(-math.pi / 2, math.pi / 2, 24, endpoint=False):
        direction = one.direction(wrinkled_view(normal, wavelength_mm=wavelength_mm, noise=3.0))
        assert_valid(direction)
        assert axis_error(direction.vector, normal) < TOLERANCE_DEG
        assert direction.coherence > 0.4


@every_axial
def test_the_direction_turns_and_is_mirrored_with_the_picture(one):
    view = wrinkled_view(0.35, noise=3.0)
    plain, turned = one.direction(view), one.direction(mapped(view, np.rot90))
    assert axis_error(turned.vector, angle(plain) + math.pi / 2) < 0.5
    assert turned.coherence == pytest.approx(plain.coherence, abs=0.02)
    for mirror in (np.flipud, np.fliplr):
        assert axis_error(one.direction(mapped(view, mirror)).vector, -angle(plain)) < 0.5


@every_axial
def test_deeper_wrinkles_are_stronger(one):
    strengths = [one.direction(wrinkled_view(depth=depth)).strength for depth in (0.03, 0.06, 0.12)]
    assert strengths[1] == pytest.approx(2 * strengths[0], rel=0.2)
    assert strengths[2] == pytest.approx(2 * strengths[1], rel=0.2)


@every
def test_the_outline_of_the_cloth_is_not_a_wrinkle(one):
    """A strip of flat cloth: only its straight outline could give it a direction."""
    view = wrinkled_view(depth=0.0)
    cloth = view.cloth & (np.arange(view.cloth.shape[1]) < 60)
    rgb = np.where(cloth[..., None], view.rgb, 205).astype(np.uint8)
    assert_none(one.direction(replace(view, rgb=rgb, cloth=cloth, contact=cloth)))
