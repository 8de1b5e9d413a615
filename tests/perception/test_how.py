"""HOW's own properties: bands, grid, order of its numbers. What all descriptors owe is in test_descriptor."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from scipy.signal import oaconvolve

from layflat.perception.camera.rectified_view import ClothView
from layflat.perception.descriptors.gabor import gabor_bank
from layflat.perception.descriptors.how import HowConfig, HowDescriptor
from layflat.perception.descriptors.preprocess import PreprocessConfig, preprocess
from layflat.perception.errors import PerceptionError

HOW = HowDescriptor()


def striped(normal: float, wavelength_mm: float, *, columns: slice = slice(None)) -> ClothView:
    """A cloth of 0.35 m with sine stripes of 10 % within ``columns`` of the view, perpendicular at ``normal`` rad."""
    row, column = np.mgrid[:160, :160]
    along = (column * math.cos(normal) - row * math.sin(normal)) * 2.5
    shade = np.ones((160, 160))
    shade[:, columns] += (0.1 * np.sin(2 * math.pi * along / wavelength_mm))[:, columns]
    cloth = np.zeros((160, 160), dtype=bool)
    cloth[10:-10, 10:-10] = True
    rgb = np.where(cloth[..., None], np.array([40.0, 90.0, 200.0]) * shade[..., None], 205.0)
    height = np.full(cloth.shape, 0.004, np.float32)
    return ClothView(rgb=np.rint(rgb).astype(np.uint8), cloth=cloth, contact=cloth, height=height, mm_per_px=2.5)


def table(view: ClothView) -> np.ndarray:
    """(wavelength, orientation, row, column)"""
    return HOW.describe(view).reshape(2, 8, 4, 4)


def test_short_wrinkles_are_in_the_high_band_and_long_ones_in_the_low_one() -> None:
    short, long = table(striped(0.0, 35.0)), table(striped(0.0, 90.0))
    assert short[0].max() > 2 * short[1].max()
    assert long[1].max() > 2 * long[0].max()


@pytest.mark.parametrize("index", range(8))
def test_the_strongest_orientation_is_the_wrinkles(index: int) -> None:
    """Number i is of wrinkles at i pi / 8 from the x axis, as WORD's weights."""
    view = striped(index * math.pi / 8 + math.pi / 2, 58.0)
    assert int(table(view).sum(axis=(0, 2, 3)).argmax()) == index


def test_cells_say_where_the_wrinkles_are() -> None:
    half = table(striped(0.0, 45.0, columns=slice(0, 80))).sum(axis=(0, 1))
    assert half[:, :2].min() > 2 * half[:, 2:].max()
    np.testing.assert_allclose(half[0], half[3], rtol=0.2)


def test_a_cell_is_the_mean_response_in_it() -> None:
    """By scipy's convolution of the prepared picture, and by slices of the cloth's 140 x 140 px."""
    view, prepare_config = striped(0.4, 58.0), PreprocessConfig(decimation=1)
    config = HowConfig(wavelengths_mm=(58.0,), orientations=2, grid=(2, 2), preprocess=prepare_config)
    prepared = preprocess(view, prepare_config)
    assert prepared is not None
    wanted = []
    for theta in (-math.pi / 2, 0.0):  # normals of wrinkles along x and along y, rows down
        kernel = gabor_bank(config.gabor(58.0, 2.5), (theta,))[0]
        response = np.abs(oaconvolve(np.pad(prepared.image, 50, mode="edge"), kernel[::-1, ::-1], "same"))[
            60:200, 60:200
        ]
        wanted += [response[r, c].mean() for r in (slice(70), slice(70, 140)) for c in (slice(70), slice(70, 140))]
    np.testing.assert_allclose(HowDescriptor(config).describe(view), wanted, rtol=1e-4)


def test_resolution_does_not_matter() -> None:
    view = striped(0.4, 58.0)
    fine = ClothView(
        rgb=cv2.resize(view.rgb, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC),
        cloth=view.cloth.repeat(2, 0).repeat(2, 1),
        contact=view.contact.repeat(2, 0).repeat(2, 1),
        height=view.height.repeat(2, 0).repeat(2, 1),
        mm_per_px=1.25,
    )
    one, two = HOW.describe(view), HOW.describe(fine)
    assert np.linalg.norm(two - one) < 0.1 * np.linalg.norm(one)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"orientations": 1}, "1 orientations"),
        ({"wavelengths_mm": ()}, "0 wavelengths"),
        ({"grid": (0, 4)}, r"a grid of \(0, 4\)"),
        ({"wavelengths_mm": (0.0,)}, "must be positive"),
        ({"noise_floor": -1.0}, "noise_floor is -1.0"),
    ],
)
def test_impossible_settings_are_refused(wrong: dict, said: str) -> None:
    with pytest.raises(PerceptionError, match=said):
        HowConfig(**wrong)


def test_impossible_preparations_are_refused() -> None:
    with pytest.raises(PerceptionError, match="decimation is 0"):
        PreprocessConfig(decimation=0)
    with pytest.raises(PerceptionError, match="must not be negative"):
        PreprocessConfig(erosion_mm=-1.0)
