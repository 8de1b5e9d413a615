"""HOW's own properties: bands, grid, order of its numbers. What all descriptors owe is in test_conformance."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import oaconvolve

from layflat.perception.descriptors.gabor import gabor_bank
from layflat.perception.descriptors.how import HowConfig, HowDescriptor
from layflat.perception.descriptors.preprocess import PreprocessConfig, preprocess
from layflat.tests.perception.factories import finer, striped_view

HOW = HowDescriptor()


def cells(view) -> np.ndarray:
    """(wavelength, orientation, row, column)"""
    return HOW.describe(view).reshape(2, 8, 4, 4)


def test_short_wrinkles_are_in_the_high_band_and_long_ones_in_the_low_one():
    short, long = (cells(striped_view(0.0, wavelength_mm=length)) for length in (35.0, 90.0))
    assert short[0].max() > 2 * short[1].max()
    assert long[1].max() > 2 * long[0].max()


@pytest.mark.parametrize("index", range(8))
def test_the_strongest_orientation_is_the_wrinkles(index):
    """Number i is of wrinkles at i pi / 8 from the x axis, as WORD's weights."""
    view = striped_view(index * math.pi / 8 + math.pi / 2)
    assert int(cells(view).sum(axis=(0, 2, 3)).argmax()) == index


def test_cells_are_where_the_wrinkles_are():
    striped, plain = striped_view(0.0, wavelength_mm=45.0), striped_view(depth=0.0)
    left = (np.arange(160) < 80)[None, :, None]
    half = cells(replace(striped, rgb=np.where(left, striped.rgb, plain.rgb))).sum(axis=(0, 1))
    assert half[:, :2].min() > 2 * half[:, 2:].max()
    np.testing.assert_allclose(half[0], half[3], rtol=0.2)


def test_a_cell_is_the_mean_response_in_it():
    """By scipy's convolution of the preprocessed picture, and by slices of the cloth's 140 x 140 px."""
    view, preprocess_config = striped_view(0.4), PreprocessConfig(decimation=1)
    config = HowConfig(wavelengths_mm=(58.0,), orientations=2, grid=(2, 2), preprocess=preprocess_config)
    image = np.pad(preprocess(view, preprocess_config).image, 50, mode="edge")
    wanted = []
    for theta in (-math.pi / 2, 0.0):  # normals of wrinkles along x and along y, rows down
        kernel = gabor_bank(config.gabor(58.0, 2.5), (theta,))[0]
        response = np.abs(oaconvolve(image, kernel[::-1, ::-1], "same"))[60:200, 60:200]
        wanted += [response[r, c].mean() for r in (slice(70), slice(70, 140)) for c in (slice(70), slice(70, 140))]
    np.testing.assert_allclose(HowDescriptor(config).describe(view), wanted, rtol=1e-4)


def test_resolution_does_not_matter():
    view = striped_view(0.4)
    one, two = HOW.describe(view), HOW.describe(finer(view))
    assert np.linalg.norm(two - one) < 0.1 * np.linalg.norm(one)
