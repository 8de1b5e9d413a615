"""HOG, histogram of oriented gradients (Dalal and Triggs 2005; thesis 2-2), by OpenCV, in table coordinates."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.perception.camera.rectified_view import ClothView, bounding_window
from layflat.perception.descriptors.base import WrinkleDirection, axial_mean
from layflat.perception.descriptors.preprocess import PreprocessConfig, PreprocessedImage, preprocess
from layflat.perception.errors import PerceptionError

GREY = 128.0
"""Grey level of the cloth's mean brightness: HOG takes 8-bit images."""


@dataclass(frozen=True, kw_only=True)
class HogConfig:
    """Dalal and Triggs' cells, blocks and bins on a square window."""

    window_px: int = 64
    """The cloth's bounding square is resized to this: 5.5 mm a pixel for a towel of 0.35 m."""
    cell_px: int = 8
    bins: int = 9
    """Of the gradient's orientation, 0 to 180 degrees."""
    noise_floor: float = 0.001
    """Strength below which there is no direction, relative brightness a window pixel. A flat cloth with sensor noise of
    6 grey levels shows 0.0003; wrinkles of 58 mm and 2 % of the brightness 0.007."""
    preprocess: PreprocessConfig = field(default_factory=lambda: PreprocessConfig(decimation=1))

    def __post_init__(self) -> None:
        if self.cell_px < 1 or self.window_px % self.cell_px or self.window_px < 2 * self.cell_px:
            raise PerceptionError(
                f"a window of {self.window_px} px does not hold two or more whole cells of {self.cell_px} px"
            )
        if self.bins < 2 or self.noise_floor < 0:
            raise PerceptionError(
                f"bins is {self.bins} and noise_floor {self.noise_floor}; they must be at least 2 and 0"
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
        block, stride, apart = (2 * cell, 2 * cell), (cell, cell), (cell, cell)
        # The last argument: without it OpenCV takes the square root of the grey levels, and brightness is already
        # relative to the cloth's mean. Before it OpenCV's defaults: a central difference, L2-Hys clipped at 0.2.
        self._hog = make((window, window), block, stride, apart, self.config.bins, 1, -1.0, 0, 0.2, False)

    @property
    def size(self) -> int:
        return int(self._hog.getDescriptorSize())

    def describe(self, view: ClothView) -> NDArray[np.float64]:
        """(size,) in OpenCV's order, each block normalised (L2-Hys), of the whole cloth."""
        prepared = preprocess(view, self.config.preprocess)
        if prepared is None:
            return np.zeros(self.size)
        return np.asarray(self._hog.compute(self._grey(prepared)), dtype=np.float64).ravel()

    def direction(self, view: ClothView) -> WrinkleDirection:
        """Axial mean over the histogram of what lies on the table: a gradient points across its wrinkle.

        From the votes before the blocks are normalised, since normalising makes noise as strong as wrinkles. Strength
        is the mean gradient, relative brightness a window pixel.
        """
        prepared = preprocess(view, self.config.preprocess)
        if prepared is None or not prepared.lying.any():
            return WrinkleDirection.none()
        lying = _fitted(prepared.lying.astype(np.float32), prepared, self.config.window_px, 0.0) > 0.5
        if not lying.any():
            return WrinkleDirection.none()
        # Each pixel votes for the two bins beside its angle; a central difference spans two pixels.
        votes, nearest = self._hog.computeGradient(self._grey(prepared), None, None)
        counts = np.bincount(nearest[lying].ravel(), votes[lying].ravel(), self.config.bins)
        histogram = np.asarray(counts, dtype=np.float64)
        if not histogram.any():
            return WrinkleDirection.none()
        # Bins are centred on half steps; the window's rows run against y.
        angle = (np.arange(self.config.bins) + 0.5) * math.pi / self.config.bins
        vector, coherence = axial_mean(histogram, np.column_stack([np.cos(angle), -np.sin(angle)]))
        # Noise has gradients in all directions, as large as those of shallow wrinkles: what they share does not count.
        strength = float(coherence * histogram.sum() / np.count_nonzero(lying) / 2 / GREY)
        if strength <= self.config.noise_floor:
            return WrinkleDirection.none()
        return WrinkleDirection(vector=vector, coherence=coherence, strength=strength)

    def _grey(self, prepared: PreprocessedImage) -> NDArray[np.uint8]:
        """(window, window) the cloth, its mean brightness at GREY."""
        fitted = _fitted(prepared.image, prepared, self.config.window_px, 1.0)
        return np.clip(np.rint(GREY * fitted), 0, 255).astype(np.uint8)


def _fitted(array: NDArray[np.float32], prepared: PreprocessedImage, side: int, beyond: float) -> NDArray[np.float32]:
    """(side, side): the cloth's bounding square, resized; ``beyond`` where it leaves the view.

    Both axes by the same factor: anything else would turn oblique wrinkles.
    """
    window = bounding_window(prepared.cloth)
    part = array if window is None else array[window]
    height, width = part.shape
    square = max(height, width)
    top, left = (square - height) // 2, (square - width) // 2
    padded = cv2.copyMakeBorder(
        part, top, square - height - top, left, square - width - left, cv2.BORDER_CONSTANT, value=beyond
    )
    return np.asarray(cv2.resize(padded, (side, side), interpolation=cv2.INTER_AREA), dtype=np.float32)
