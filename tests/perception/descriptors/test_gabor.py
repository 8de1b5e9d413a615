"""Eq. 3-1 against OpenCV's Gabor kernel and against what a Gabor must do."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from layflat.perception.arrays import WHOLE
from layflat.perception.descriptors.gabor import GaborParams, gabor_bank, gabor_kernel, gabor_responses

PARAMS = st.builds(
    GaborParams,
    wavelength=st.floats(3, 30),
    sigma=st.floats(1, 10),
    gamma=st.floats(0.1, 1),
    psi=st.floats(-10, 10),
    size=st.integers(1, 33),
)
RIDGE = GaborParams(wavelength=11.6, sigma=3.6, gamma=0.3, psi=math.pi / 2, size=15)
EIGHT = tuple(i * math.pi / 8 for i in range(8))


@given(params=PARAMS, theta=st.floats(0, math.pi))
def test_equals_opencv_with_the_phase_shifted_by_a_quarter(params, theta):
    size = (params.size, params.size)
    theirs = cv2.getGaborKernel(
        size, params.sigma, theta, params.wavelength, params.gamma, params.psi - math.pi / 2, cv2.CV_64F
    )
    if params.size % 2:  # OpenCV enlarges even sizes by one; so do we
        assert theirs.shape == size
    np.testing.assert_allclose(gabor_kernel(params, theta), theirs, atol=1e-9)


def test_the_thesis_window_of_12_is_13():
    assert gabor_kernel(GaborParams(wavelength=8, sigma=4, gamma=0.1, psi=10, size=12), 0.3).shape == (13, 13)


@given(params=PARAMS, theta=st.floats(0, math.pi))
def test_orientation_has_period_pi_for_even_kernels(params, theta):
    even = GaborParams(**{**params.__dict__, "psi": math.pi / 2})
    np.testing.assert_allclose(gabor_kernel(even, theta), gabor_kernel(even, theta + math.pi), atol=1e-9)


def test_a_constant_image_gives_nothing():
    image = np.full((40, 40), 3.7, dtype=np.float32)
    for kernel in gabor_bank(RIDGE, EIGHT):
        assert np.abs(cv2.filter2D(image, cv2.CV_32F, kernel)).max() < 1e-5


@pytest.mark.parametrize("theta", EIGHT)
def test_a_matching_wave_of_amplitude_one_answers_with_amplitude_one(theta):
    y, x = np.mgrid[:90, :90]
    wave = np.sin(2 * math.pi * (x * math.cos(theta) + y * math.sin(theta)) / RIDGE.wavelength)
    responses = [cv2.filter2D(wave.astype(np.float32), cv2.CV_32F, k)[15:75, 15:75] for k in gabor_bank(RIDGE, EIGHT)]
    amplitude = [math.sqrt(2 * np.mean(r**2)) for r in responses]
    assert amplitude[EIGHT.index(theta)] == pytest.approx(1.0, abs=0.03)
    assert int(np.argmax(amplitude)) == EIGHT.index(theta)


@given(seed=st.integers(0, 2**16))
def test_rotating_the_image_by_90_degrees_rolls_the_responses(seed):
    image = np.random.default_rng(seed).normal(size=(32, 32)).astype(np.float32)
    bank = gabor_bank(RIDGE, EIGHT)

    def sums(picture: np.ndarray) -> np.ndarray:
        picture = np.ascontiguousarray(picture)
        return np.array([np.abs(cv2.filter2D(picture, cv2.CV_32F, k)).sum() for k in bank])

    np.testing.assert_allclose(sums(np.rot90(image)), np.roll(sums(image), 4), rtol=1e-4)


def test_banks_are_cached_and_read_only():
    bank = gabor_bank(RIDGE, EIGHT)
    assert gabor_bank(RIDGE, EIGHT) is bank
    with pytest.raises(ValueError, match="read-only"):
        bank[0, 0, 0] = 1.0


@pytest.mark.parametrize("shape", [(1, 1), (5, 7), (152, 151), (33, 200)])
@pytest.mark.parametrize("size", [1, 12, 31])
@pytest.mark.parametrize("psi", [10.0, math.pi / 2, 0.0])
def test_responses_are_those_of_filter2d(shape, size, psi):
    image = np.random.default_rng(2).normal(1.0, 0.3, shape).astype(np.float32)
    params = GaborParams(wavelength=10, sigma=4, gamma=0.4, psi=psi, size=size)
    bottom, right = max(1, shape[0] // 2), max(1, shape[1] - 3)
    for window in (WHOLE, (slice(0, bottom), slice(0, right)), (slice(bottom - 1, shape[0]), slice(right - 1, right))):
        fast = gabor_responses(image, params, EIGHT, normalize=False, window=window)
        for kernel, response in zip(gabor_bank(params, EIGHT, False), fast, strict=True):
            plain = cv2.filter2D(image, cv2.CV_32F, kernel, borderType=cv2.BORDER_REPLICATE)[window]
            np.testing.assert_allclose(response, plain, atol=1e-5 * np.abs(kernel).sum())
