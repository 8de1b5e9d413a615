"""Gabor kernels (Eq. 3-1 of the thesis), banks of kernels, and an image's responses to a bank."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from layflat.perception.arrays import WHOLE, Float32Array, Float64Array, Window
from layflat.perception.errors import PerceptionError

DFT_STEP = 4
"""Transform sizes are multiples of this: few occur while a cloth moves, and their spectra stay cached."""


@dataclass(frozen=True, kw_only=True)
class GaborParams:
    """Parameters of Eq. 3-1, lengths in pixels."""

    wavelength: float
    """lambda, one period of the sine."""
    sigma: float
    """Standard deviation of the envelope across the stripes."""
    gamma: float
    """Aspect ratio: the envelope is sigma / gamma long along the stripes."""
    psi: float
    """Phase of the sine, rad. 0 is odd (an edge), pi/2 even (a ridge)."""
    size: int
    """Side of the window; an even side is enlarged by one, as OpenCV does (12 -> 13)."""

    def __post_init__(self) -> None:
        if not (self.wavelength > 0 and self.sigma > 0 and self.gamma > 0 and self.size >= 1):
            raise PerceptionError(f"{self}: wavelength, sigma, gamma and size must be positive")


def gabor_kernel(params: GaborParams, theta: float) -> Float64Array:
    """Return Eq. 3-1, (k, k) with k = 2 (size // 2) + 1, for stripes whose normal is at ``theta`` rad from the columns.

    g = exp(-(x'^2 + gamma^2 y'^2) / (2 sigma^2)) * sin(2 pi x' / lambda + psi),
    x' = x cos(theta) + y sin(theta), y' = -x sin(theta) + y cos(theta), x right and y down.
    The layout is that of ``cv2.getGaborKernel`` (point-mirrored, so that ``filter2D``, a correlation, convolves with
    g). That function has a cosine where the thesis has a sine: it gives this kernel for its psi = ours - pi/2.
    """
    envelope, along = _envelope_and_axis(params, theta)
    return np.asarray(envelope * np.sin(2 * math.pi * along / params.wavelength + params.psi))


@lru_cache(maxsize=64)
def gabor_bank(params: GaborParams, thetas: tuple[float, ...], normalize: bool = True) -> Float32Array:
    """Return (n, k, k) kernels, read-only.

    ``normalize`` removes the response to a constant image, by subtracting a share of the envelope (a constant would be
    seen as a box), and scales so that a plane wave of the same wavelength and direction and of amplitude 1 gives
    responses of amplitude 1: responses are then in units of the image, and no orientation is favoured by the way the
    square window cuts its envelope. Without it the kernels are Eq. 3-1 as it stands.
    """
    kernels = []
    for theta in thetas:
        kernel = gabor_kernel(params, theta)
        if normalize:
            envelope, along = _envelope_and_axis(params, theta)
            kernel = kernel - envelope * (kernel.sum() / envelope.sum())
            kernel = kernel / abs(np.sum(kernel * np.exp(-2j * math.pi * along / params.wavelength)))
        kernels.append(kernel)
    bank = np.array(kernels, dtype=np.float32)
    bank.setflags(write=False)
    return bank


def gabor_responses(
    image: Float32Array,
    params: GaborParams,
    thetas: tuple[float, ...],
    *,
    normalize: bool = True,
    window: Window = WHOLE,
) -> Iterator[Float32Array]:
    """Yield for each kernel the ``window`` (h, w) of what ``filter2D`` with BORDER_REPLICATE gives.

    The image is transformed once and the kernels' spectra are cached, so that an orientation costs one multiplication
    and one inverse transform for a kernel of any size; only the pixels that the window depends on take part. All
    responses share one buffer: use or copy each before asking for the next.
    """
    half = params.size // 2
    (top, bottom), (left, right) = (part.indices(size)[:2] for part, size in zip(window, image.shape, strict=True))
    height, width = bottom - top, right - left
    rows, columns = _dft_size(height + 2 * half), _dft_size(width + 2 * half)
    source = image[max(0, top - half) : bottom + half, max(0, left - half) : right + half]
    above, before = max(0, half - top), max(0, half - left)
    below, behind = rows - above - source.shape[0], columns - before - source.shape[1]
    spectrum = cv2.dft(cv2.copyMakeBorder(source, above, below, before, behind, borderType=cv2.BORDER_REPLICATE))
    inverse = cv2.DFT_INVERSE | cv2.DFT_SCALE | cv2.DFT_REAL_OUTPUT
    product, whole = np.empty((rows, columns), dtype=np.float32), np.empty((rows, columns), dtype=np.float32)
    for kernel, even in _spectra(params, thetas, normalize, rows, columns):
        if even:
            np.multiply(spectrum, kernel, out=product)
        else:
            cv2.mulSpectrums(spectrum, kernel, 0, product, conjB=True)
        cv2.dft(product, whole, flags=inverse)
        yield whole[half : half + height, half : half + width]


@lru_cache(maxsize=24)
def _spectra(
    params: GaborParams, thetas: tuple[float, ...], normalize: bool, rows: int, columns: int
) -> tuple[tuple[Float32Array, bool], ...]:
    """Return the kernels' spectra, centred on the origin, in OpenCV's packed form; and which kernels are even.

    The spectrum of an even kernel is real: it is stored in the places of both parts, so that a plain product suffices.
    """
    spectra = []
    for kernel in gabor_bank(params, thetas, normalize):
        padded = np.zeros((rows, columns), dtype=np.float32)
        padded[: len(kernel), : len(kernel)] = kernel
        half = len(kernel) // 2
        spectrum = np.asarray(cv2.dft(np.roll(padded, (-half, -half), (0, 1))), dtype=np.float32)
        even = bool(np.allclose(kernel, kernel[::-1, ::-1], atol=1e-6 * np.abs(kernel).max()))
        spectra.append((_duplicate_real_parts(spectrum) if even else spectrum, even))
    return tuple(spectra)


def _duplicate_real_parts(packed: Float32Array) -> Float32Array:
    """Copy each real part of a packed spectrum to the place of its imaginary part (even numbers of rows and columns).

    Columns are real 0, then real and imaginary in pairs, then the last real; the first and last column are packed
    along the rows in the same way.
    """
    double = packed.copy()
    double[:, 2:-1:2] = double[:, 1:-2:2]
    double[2:-1:2, [0, -1]] = double[1:-2:2, [0, -1]]
    return double


def _dft_size(min_size: int) -> int:
    """Return the next size that transforms fast, a multiple of DFT_STEP."""
    size = DFT_STEP * math.ceil(min_size / DFT_STEP)
    while cv2.getOptimalDFTSize(size) != size:
        size += DFT_STEP
    return size


def _envelope_and_axis(params: GaborParams, theta: float) -> tuple[Float64Array, Float64Array]:
    """Return the Gaussian envelope and x' on the kernel's pixels."""
    half = params.size // 2
    offsets = np.arange(half, -half - 1, -1, dtype=np.float64)
    x, y = offsets[None, :], offsets[:, None]
    along = x * math.cos(theta) + y * math.sin(theta)
    across = -x * math.sin(theta) + y * math.cos(theta)
    return np.exp(-(along**2 + params.gamma**2 * across**2) / (2 * params.sigma**2)), along
