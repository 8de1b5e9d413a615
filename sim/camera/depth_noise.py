"""DepthSensor: the errors of a stereo depth camera of the RealSense D435 kind.

Depth comes from disparity d = f B / z, so an error of the match of ``subpixel_px`` becomes sigma_z = z^2 * subpixel /
(f B), depths come in steps of disparity, neighbouring pixels share their error (they share a matching window), and
pixels are missing where one imager sees what the other does not: along depth edges, and in a few blots elsewhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from layflat.sim.errors import SimError

DepthImage = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True)
class DepthNoise:
    """Error model. The defaults give 2.6 mm rms at 1 m."""

    focal_px: float = 385.0
    """Focal length of the depth imager at 640 columns; a D435 has 90 degrees of view across 848."""
    baseline_m: float = 0.05
    subpixel_px: float = 0.05
    """Rms error of the disparity; 0.05 to 0.1 is usual for textured surfaces."""
    disparity_step_px: float = 1 / 32
    correlation_px: float = 0.8
    """Standard deviation of the Gaussian window that neighbouring errors share, image pixels."""
    missing_share: float = 0.007
    """Share of the pixels away from edges without a value."""
    missing_at_edges: float = 0.5
    """Share of the pixels at a depth edge without a value."""
    edge_step_px: float = 0.25
    """Least jump of the disparity between neighbours at an edge: about 13 mm at 1 m."""
    range_m: tuple[float, float] = (0.2, 4.0)
    """Nearest and farthest depth with a value."""

    def __post_init__(self) -> None:
        for field in ("focal_px", "baseline_m", "disparity_step_px", "correlation_px", "edge_step_px"):
            if not getattr(self, field) > 0:
                raise SimError(f"depth noise: {field} is {getattr(self, field)}; it must be above 0")
        for field in ("missing_share", "missing_at_edges"):
            if not 0 <= getattr(self, field) < 1:
                raise SimError(f"depth noise: {field} is {getattr(self, field)}; it must be in [0, 1)")
        if self.subpixel_px < 0 or not 0 <= self.range_m[0] < self.range_m[1]:
            raise SimError(
                f"depth noise: subpixel_px {self.subpixel_px} or range_m {self.range_m} is invalid;"
                " subpixel_px must be at least 0, and range_m must rise from at least 0"
            )

    @property
    def disparity_m(self) -> float:
        """Product of depth and disparity, f B, px m."""
        return self.focal_px * self.baseline_m


class DepthSensor:
    """Adds errors to depth images; the same seed and the same images give the same bits."""

    def __init__(self, noise: DepthNoise, *, seed: int) -> None:
        self.noise = noise
        self._rng = np.random.default_rng(seed)

    def measure(self, depth: DepthImage) -> DepthImage:
        """Return the measured depth (H, W) m, 0 where missing, of a true ``depth``, 0 where there is nothing."""
        noise = self.noise
        near, far = noise.range_m
        seen = (depth > near) & (depth < far)
        disparity: DepthImage = np.float32(noise.disparity_m) / np.where(seen, depth, far).astype(np.float32)
        missing = self._missing(disparity)
        error = self._field(depth.shape, noise.correlation_px) * np.float32(noise.subpixel_px)
        step = np.float32(noise.disparity_step_px)
        measured = np.rint((disparity + error) / step) * step
        out: DepthImage = (noise.disparity_m / np.maximum(measured, step)).astype(np.float32)
        out[~seen | missing] = 0.0
        return out

    def _missing(self, disparity: DepthImage) -> NDArray[np.bool_]:
        """Return blots: where a smooth field is below a quantile, a higher one at edges."""
        noise = self.noise
        field = self._field(disparity.shape, 1.5 * noise.correlation_px)
        cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
        jump = cv2.dilate(disparity, cross) - cv2.erode(disparity, cross)
        return field < np.where(
            jump > noise.edge_step_px, np.float32(ndtri(noise.missing_at_edges)), np.float32(ndtri(noise.missing_share))
        )

    def _field(self, shape: tuple[int, ...], sigma_px: float) -> DepthImage:
        """Return standard normal values (H, W), each correlated with its neighbours."""
        size = 2 * math.ceil(2.5 * sigma_px) + 1
        kernel = cv2.getGaussianKernel(size, sigma_px, cv2.CV_32F)
        white = self._rng.standard_normal(shape, dtype=np.float32)
        # A filter with weights w multiplies the variance of white noise by sum(w^2), separably for rows and columns.
        kernel = kernel / np.sqrt((kernel**2).sum())
        return np.asarray(cv2.sepFilter2D(white, cv2.CV_32F, kernel, kernel), dtype=np.float32)
