"""HOG, histogram of oriented gradients (Dalal and Triggs 2005; thesis 2-2), by OpenCV, in table coordinates."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.perception.arrays import Float32Array, Float64Array, bounding_window
from layflat.perception.camera.rectified_view import ClothView
from layflat.perception.descriptors.base import WrinkleDirection, axial_mean
from layflat.perception.descriptors.preprocess import PreprocessConfig, PreprocessedImage, preprocess
from layflat.perception.errors import PerceptionError

MEAN_GREY = 128.0
"""Grey level of the cloth's mean brightness: HOG takes 8-bit images."""


@dataclass(frozen=True, kw_only=True)
class HogConfig:
    """Dalal and Triggs' cells, blocks and bins on a square window."""

    window_px: int = 64
    """The cloth's bounding square is resized to this: 5.5 mm a pixel for a towel of 0.35 m."""
    cell_px: int = 8
    bins: int = 9
    """Bins of the gradient's orientation, 0 to 180 degrees."""
    noise_floor: float = 0.001
    """Strength below which there is no direction, relative brightness a window pixel. A flat cloth with sensor noise of
    6 grey levels has 0.0003; wrinkles of 58 mm and 2 % of the brightness 0.007."""
    preprocess: PreprocessConfig = field(default_factory=lambda: PreprocessConfig(decimation=1))

    def __post_init__(self) -> None:
        if self.cell_px < 1 or self.window_px % self.cell_px or self.window_px < 2 * self.cell_px:
            window, cell = f"{self.window_px} px", f"{self.cell_px} px"
            raise PerceptionError(f"a window of {window} does not hold two or more whole cells of {cell}")
        if self.bins < 2 or self.noise_floor < 0:
            raise PerceptionError(
                f"bins is {self.bins} and noise_floor {self.noise_floor}; at least 2 and 0 are needed"
            )


class HogDescriptor:
    """HOG as a Descriptor: blocks of 2 x 2 cells, one cell apart, x bins."""

    name = "hog"

    def __init__(self, config: HogConfig | None = None) -> None:
        self.config = HogConfig() if config is None else config
        # OpenCV 5 has it in its contributed modules only.
        make: Any = getattr(cv2, "HOGDescriptor", None)
        if make is None:
            raise PerceptionError(
                f"OpenCV {cv2.__version__} is installed without HOGDescriptor; "
                "install opencv-python-headless 4.11 or later, below 5"
            )
        window, cell = self.config.window_px, self.config.cell_px
        block, stride = (2 * cell, 2 * cell), (cell, cell)
        # The last argument is gammaCorrection: OpenCV would take the square root of the grey levels, but brightness is
        # already relative to the mean. Before it OpenCV's defaults: a central difference, L2-Hys clipped at 0.2.
        self._hog = make((window, window), block, stride, stride, self.config.bins, 1, -1.0, 0, 0.2, False)

    @property
    def size(self) -> int:
        """Length of the vector."""
        return int(self._hog.getDescriptorSize())

    def describe(self, view: ClothView) -> Float64Array:
        """Return (size,) numbers in OpenCV's order, each block normalized (L2-Hys), of the whole cloth."""
        preprocessed = preprocess(view, self.config.preprocess)
        if preprocessed is None:
            return np.zeros(self.size)
        return np.asarray(self._hog.compute(self._grey(preprocessed)), dtype=np.float64).ravel()

    def direction(self, view: ClothView) -> WrinkleDirection:
        """Return the axial mean over the histogram of what lies on the table: a gradient points across its wrinkle.

        It uses the votes before the blocks are normalized, since normalizing makes noise as strong as wrinkles.
        Strength is the mean gradient, relative brightness a window pixel.
        """
        preprocessed = preprocess(view, self.config.preprocess)
        if preprocessed is None:
            return WrinkleDirection.none()
        valid = _fit_window(preprocessed.valid.astype(np.float32), preprocessed, self.config.window_px, 0.0) > 0.5
        histogram = self._histogram(preprocessed, valid)
        if not histogram.any():
            return WrinkleDirection.none()
        # Bins are centred on half steps; the window's rows run against y.
        angle = (np.arange(self.config.bins) + 0.5) * math.pi / self.config.bins
        vector, coherence = axial_mean(histogram, np.column_stack([np.cos(angle), -np.sin(angle)]))
        # Noise has gradients in all directions, as large as those of shallow wrinkles: what they share does not count.
        # A central difference spans two pixels.
        strength = float(coherence * histogram.sum() / np.count_nonzero(valid) / 2 / MEAN_GREY)
        if strength <= self.config.noise_floor:
            return WrinkleDirection.none()
        return WrinkleDirection(vector=vector, coherence=coherence, strength=strength)

    def _histogram(self, preprocessed: PreprocessedImage, valid: NDArray[np.bool_]) -> Float64Array:
        """Return (bins,) votes of the window's ``valid`` pixels; each votes for the two bins beside its angle."""
        votes, nearest = self._hog.computeGradient(self._grey(preprocessed), None, None)
        return np.bincount(nearest[valid].ravel(), votes[valid].ravel(), self.config.bins).astype(np.float64)

    def _grey(self, preprocessed: PreprocessedImage) -> NDArray[np.uint8]:
        """Return (window, window) the cloth with its mean brightness at MEAN_GREY."""
        fitted = _fit_window(preprocessed.image, preprocessed, self.config.window_px, 1.0)
        return np.clip(np.rint(MEAN_GREY * fitted), 0, 255).astype(np.uint8)


def _fit_window(image: Float32Array, preprocessed: PreprocessedImage, side: int, background: float) -> Float32Array:
    """Resize the cloth's bounding square to (side, side), with ``background`` where it leaves the view.

    Both axes have the same factor: otherwise oblique wrinkles would turn.
    """
    window = bounding_window(preprocessed.cloth)
    part = image if window is None else image[window]
    height, width = part.shape
    square = max(height, width)
    top, left = (square - height) // 2, (square - width) // 2
    bottom, right = square - height - top, square - width - left
    padded = cv2.copyMakeBorder(part, top, bottom, left, right, cv2.BORDER_CONSTANT, value=background)
    return np.asarray(cv2.resize(padded, (side, side), interpolation=cv2.INTER_AREA), dtype=np.float32)
