"""HOW, histogram of oriented wrinkles (Jia, Hu, Pan and Manocha, ICRA 2018; thesis 2-2, 3-1-1), table coordinates.

As far as the thesis and the paper's outline describe it: Gabor filters of several orientations and wavelengths over the
cloth, responses summed over the cells of a grid, a few hundred numbers. They give no parameters; HowConfig has ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

import cv2
import numpy as np

from layflat.perception.arrays import Float32Array, Float64Array, bounding_window
from layflat.perception.camera.rectified_view import ClothView
from layflat.perception.descriptors.base import WrinkleDirection, axial_mean, filter_angles, wrinkle_normals
from layflat.perception.descriptors.gabor import GaborParams, gabor_bank
from layflat.perception.descriptors.preprocess import PreprocessConfig, PreprocessedImage, preprocess
from layflat.perception.errors import PerceptionError


@dataclass(frozen=True, kw_only=True)
class HowConfig:
    """Filter bank and grid; lengths in millimetres on the cloth."""

    orientations: int = 8
    wavelengths_mm: tuple[float, ...] = (40.0, 80.0)
    """High- and low-frequency component: the Gabors of a wavelength pass a band of about an octave around it. Together
    they hold the wrinkles that a 13x13 cloth can have, 0.7 of the gain or more from 28 to 110 mm."""
    grid: tuple[int, int] = (4, 4)
    """Cells along rows and columns of the cloth's bounding box."""
    sigma: float = 0.31
    """Standard deviation of the envelope, share of the wavelength; like gamma and psi as in WORD."""
    gamma: float = 0.3
    psi: float = math.pi / 2
    size: float = 1.3
    """Side of the window, share of the wavelength."""
    noise_floor: float = 0.005
    """Strength below which there is no direction, relative brightness. A flat cloth with sensor noise of 6 grey levels
    has 0.0023; wrinkles of 58 mm and 2 % of the brightness 0.015."""
    preprocess: PreprocessConfig = field(default_factory=PreprocessConfig)

    def __post_init__(self) -> None:
        if self.orientations < 2 or min(self.grid) < 1 or not self.wavelengths_mm:
            given = (
                f"{self.orientations} orientations, {len(self.wavelengths_mm)} wavelengths and a grid of {self.grid}"
            )
            raise PerceptionError(f"{given}; at least 2, 1 and (1, 1) are needed")
        if self.noise_floor < 0:
            raise PerceptionError(f"noise_floor is {self.noise_floor}; it must not be negative")
        for wavelength in self.wavelengths_mm:
            self.gabor(wavelength, 1.0)

    def gabor(self, wavelength_mm: float, mm_per_px: float) -> GaborParams:
        """Return the parameters of Eq. 3-1 in pixels of ``mm_per_px``."""
        lengths = {"wavelength": wavelength_mm / mm_per_px, "sigma": self.sigma * wavelength_mm / mm_per_px}
        size = round(self.size * wavelength_mm / mm_per_px)
        return GaborParams(**lengths, gamma=self.gamma, psi=self.psi, size=size)


@dataclass(frozen=True)
class HowDescriptor:
    """HOW as a Descriptor: wavelengths x orientations x grid cells."""

    config: HowConfig = field(default_factory=HowConfig)
    name: ClassVar[str] = "how"

    @property
    def size(self) -> int:
        """Length of the vector."""
        return len(self.config.wavelengths_mm) * self.config.orientations * math.prod(self.config.grid)

    def describe(self, view: ClothView) -> Float64Array:
        """Return (size,) mean |response| in each cell, relative brightness; 0 where the cell has no cloth.

        Order: wavelength, orientation (i pi / n from the x axis, as in WORD), row, column of the grid. The whole cloth
        counts, also what is lifted: HOW describes its shape. Not normalized further: brightness already is.
        """
        preprocessed = preprocess(view, self.config.preprocess)
        window = None if preprocessed is None else bounding_window(preprocessed.cloth)
        if preprocessed is None or window is None:
            return np.zeros(self.size)
        rows, columns = self.config.grid
        seen = [np.where(preprocessed.cloth, np.abs(r), 0)[window] for r in self._responses(preprocessed)]
        cells = [cv2.resize(part, (columns, rows), interpolation=cv2.INTER_AREA).ravel() for part in seen]
        return np.concatenate(cells).astype(np.float64)

    def direction(self, view: ClothView) -> WrinkleDirection:
        """Return the axial mean over the orientations' energies, summed over wavelengths, of what lies on the table.

        Strength is the root of the strongest orientation's energy: rms response, relative brightness.
        """
        preprocessed = preprocess(view, self.config.preprocess)
        if preprocessed is None or not preprocessed.valid.any():
            return WrinkleDirection.none()
        mask = preprocessed.valid.view(np.uint8)
        sums = np.array([cv2.norm(r, cv2.NORM_L2SQR, mask) for r in self._responses(preprocessed)])
        energies = (sums.reshape(-1, self.config.orientations) / np.count_nonzero(mask)).sum(axis=0)
        strength = math.sqrt(energies.max())
        if strength <= self.config.noise_floor:
            return WrinkleDirection.none()
        vector, coherence = axial_mean(energies, wrinkle_normals(self.config.orientations))
        return WrinkleDirection(vector=vector, coherence=coherence, strength=strength)

    def _responses(self, preprocessed: PreprocessedImage) -> list[Float32Array]:
        """Return (h, w) responses: wavelength by wavelength, orientation by orientation."""
        angles = filter_angles(self.config.orientations)
        return [
            np.asarray(cv2.filter2D(preprocessed.image, cv2.CV_32F, kernel, borderType=cv2.BORDER_REPLICATE))
            for wavelength in self.config.wavelengths_mm
            for kernel in gabor_bank(self.config.gabor(wavelength, preprocessed.mm_per_px), angles)
        ]
