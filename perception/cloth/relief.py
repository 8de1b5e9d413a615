"""How wrinkled a cloth is and how sure its direction is: the slope tensor of its relief, less the sensor's noise.

A descriptor's numbers feed policies and stay what they are; this is the judgement beside them, for one real frame. The
relief alone counts: a print has no relief. Its noise is measured in the same picture, on the bare table, as a tensor,
so that noise with an orientation (an Xtion's steps of depth, resampling) is taken out along that orientation.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from layflat.perception.arrays import BoolArray, Float32Array, Float64Array, FloatArray, dilate, erode
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.camera.rectified_view import TableRectifier
from layflat.perception.camera.table_grid import TableGrid, grid_around
from layflat.perception.cloth.contact import MAX_HEIGHT_M, smooth_height
from layflat.perception.errors import PerceptionError

BAND_MM = (8.0, 30.0)
"""Standard deviations of the two Gaussians whose difference passes the wrinkles: half of the slope or more from 25 to
130 mm; neither the pixels' noise nor the fall of a lifted part."""
BAND_GAIN = 0.70
"""Gain for waves of 60 mm, which is taken out."""
BOX_MM = 16.0
"""Side of the box over which pixels of depth are averaged first."""
RIM_MM = 14.0
"""The relief this close to the cloth's outline does not count: hem, thickness, mixed pixels."""
HOLE_MM2 = 2000.0
"""Smaller holes in the mask (markers, labels, glare) are cloth."""
LOW_M = 0.03
"""Higher wrinkles have no direction: that cloth does not lie on the table."""
BESIDE_MM = 40.0
"""Nor have wrinkles this close to it: where a flat cloth rises it is bent."""
TOP_M = 0.99 * MAX_HEIGHT_M
"""Higher cloth does not count: its height is clipped."""
MIN_AREA_MM2 = 2500.0
"""Smallest area that has a direction: about a square of one wavelength."""
MARGIN_M = 0.2
"""Table around the cloth on which the noise is measured."""
TABLE_M = 0.015
"""Bare table is no farther than this from the fitted plane."""
GAP_MM = 20.0
"""Table this close to the cloth does not count: a lifted edge, its shadow."""
TILE_MM = 30.0
MIN_TILES, TRIMMED = 6, 0.15
"""Side and least number of the tiles of bare table, whose mean is the noise; share of them that is left out at either
end, since a thing on the table is no noise."""
MAX_SCATTER_M = 0.01
MAX_NOISE_RATIO = 3.0
"""Largest factor by which the pixels of the cloth may scatter more than the table's; a dark cloth scatters more."""

MIN_STRENGTH = 0.08
"""Relief with smaller slopes is called flat and has no direction."""
MIN_SIGNIFICANCE = 1.4
"""Least slope of cloth and noise together, in units of the noise's own, that is taken for wrinkles."""
MIN_COHERENCE = 0.2
"""Wrinkles that agree less run several ways: there is no one direction."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Wrinkles:
    """How wrinkled a piece of cloth is, whether its wrinkles have one direction, and how sure that is."""

    axis: Float64Array
    """(2,) unit vector across the wrinkles, table coordinates, x >= 0; zeros without relief."""
    coherence: float
    """0..1: 1 if all slopes lie on one axis, 0 if there are as many across it."""
    strength: float
    """Root mean square slope of the relief in m/m, without the noise."""
    noise: float
    """The same of the bare table: the sensor's noise."""

    low_strength: float
    """The strength of what lies low enough to have a direction."""

    @property
    def min_strength(self) -> float:
        """Least strength that is more than a flat cloth and the sensor's noise have."""
        return max(MIN_STRENGTH, self.noise * math.sqrt(MIN_SIGNIFICANCE**2 - 1))

    @property
    def is_flat(self) -> bool:
        """Whether the relief is no more than what a flat cloth and the sensor's noise have."""
        return self.strength < self.min_strength

    @property
    def has_direction(self) -> bool:
        """Whether the wrinkles have one direction, and are clear of the noise."""
        return self.low_strength >= self.min_strength and self.coherence >= MIN_COHERENCE

    @property
    def direction(self) -> Float64Array:
        """(2,) ``axis`` if it is sure, else zeros."""
        return self.axis if self.has_direction else np.zeros(2)


@dataclass(frozen=True, kw_only=True, eq=False)
class Relief:
    """Slope tensors of the cloth's relief in the table grid."""

    tensor: Float32Array
    """(3, h, w) products of the slopes: xx, xy, yy."""
    inner: BoolArray
    """(h, w) cloth whose relief counts."""
    low: BoolArray
    """(h, w) that part of it whose wrinkles have a direction."""
    noise: Float64Array
    """(3,) tensor of a flat cloth under this sensor."""
    grid: TableGrid

    def wrinkles(self, part: BoolArray | None = None) -> Wrinkles:
        """Return the wrinkles of the cloth, or of a ``part`` (h, w) of it, which has a direction at any height."""
        xx, xy, yy = self._mean(self.low if part is None else self.inner, part, MIN_AREA_MM2)
        power, double = xx + yy, complex(xx - yy, 2 * xy)
        half = cmath.phase(double) / 2
        whole = self._mean(self.inner, part, 0.0)
        return Wrinkles(
            axis=np.array([max(0.0, math.cos(half)), math.sin(half)]) if power > 0 else np.zeros(2),
            coherence=min(1.0, abs(double) / power) if power > 0 else 0.0,
            strength=math.sqrt(max(0.0, whole[0] + whole[2])),
            low_strength=math.sqrt(max(0.0, power)),
            noise=math.sqrt(self.noise[0] + self.noise[2]),
        )

    def _mean(self, counted: BoolArray, part: BoolArray | None, min_mm2: float) -> Float64Array:
        """Return the mean tensor (3,) less the noise, 0 where fewer than ``min_mm2`` count."""
        counted = counted if part is None else counted & part
        if np.count_nonzero(counted) * self.grid.mm_per_px**2 <= min_mm2:
            return np.zeros(3)
        return np.asarray(self.tensor[:, counted].mean(axis=1, dtype=np.float64) - self.noise)


def measure_relief(camera: PinholeCamera, depth: FloatArray, cloth: BoolArray) -> Relief:
    """Return the relief of the ``cloth`` (H, W) in an image of ``depth`` (H, W), m; 0 or NaN where there is none."""
    if depth.shape != cloth.shape:
        raise PerceptionError(f"depth has shape {depth.shape} and the cloth {cloth.shape}; they must be the same")
    grid = grid_around(camera, cloth, margin_m=MARGIN_M)
    rectifier, px_per_mm = TableRectifier(camera, grid), 1 / grid.mm_per_px
    height = camera.height_above_table(depth)
    density = _px_per_mm2(cloth, rectifier.rectify_mask(cloth), grid.mm_per_px)
    hole_px, smoothing_px = HOLE_MM2 * density, 2 * round(BOX_MM * math.sqrt(density) / 2 - 0.5) + 1
    cloth = fill_small_holes(cloth, hole_px)
    seen, smooth = rectifier.rectify_mask(cloth), rectifier.rectify(smooth_height(height, cloth, smoothing_px))
    bare = fill_small_holes(np.abs(np.nan_to_num(height, nan=1.0)) < TABLE_M, hole_px) & ~dilate(cloth, 2)
    table = rectifier.rectify_mask(bare) & ~dilate(seen, GAP_MM * px_per_mm)
    flat = rectifier.rectify(smooth_height(height, bare, smoothing_px))
    scatter = _scatter(height, bare, smoothing_px)
    ratio = _scatter(height, cloth, smoothing_px) / scatter if scatter > 0 else 1.0
    noise = _tile_mean(slope_tensor(flat, table, grid.mm_per_px), erode(table, RIM_MM * px_per_mm), grid.mm_per_px)
    inner = erode(seen, RIM_MM * px_per_mm) & (smooth < TOP_M)
    return Relief(
        tensor=slope_tensor(smooth, seen, grid.mm_per_px),
        inner=inner,
        low=inner & ~dilate(seen & (smooth > LOW_M), BESIDE_MM * px_per_mm),
        noise=noise * min(max(ratio, 1.0), MAX_NOISE_RATIO) ** 2,
        grid=grid,
    )


def slope_tensor(height: Float32Array, mask: BoolArray, mm_per_px: float) -> Float32Array:
    """Return (3, h, w) products of the slopes of ``height`` (h, w), m, in the band of wrinkles, inside ``mask``."""
    fine, coarse = (_masked_blur(height, mask, sigma / mm_per_px) for sigma in BAND_MM)
    step = 1 / (8 * mm_per_px / 1000 * BAND_GAIN)
    band = fine - coarse
    x = cv2.Sobel(band, cv2.CV_32F, 1, 0, scale=step)
    y = cv2.Sobel(band, cv2.CV_32F, 0, 1, scale=-step)
    return np.stack([x * x, x * y, y * y])


def fill_small_holes(mask: BoolArray, max_px: float) -> BoolArray:
    """Return the mask with its holes of up to ``max_px`` pixels."""
    holes, count = ndimage.label(ndimage.binary_fill_holes(mask) & ~mask)
    small = np.bincount(holes.ravel(), minlength=count + 1) <= max_px
    small[0] = False
    return mask | small[holes]


def _masked_blur(image: Float32Array, mask: BoolArray, sigma_px: float) -> Float32Array:
    weight = mask.astype(np.float32)
    total = cv2.GaussianBlur(np.where(mask, image, np.float32(0)), (0, 0), sigma_px)
    return np.asarray(total / np.maximum(cv2.GaussianBlur(weight, (0, 0), sigma_px), np.float32(1e-3)), np.float32)


def _px_per_mm2(cloth: BoolArray, seen: BoolArray, mm_per_px: float) -> float:
    """Return image pixels per mm2 of the table, on average over the cloth."""
    return np.count_nonzero(cloth) / max(1.0, np.count_nonzero(seen) * mm_per_px**2)


def _scatter(height: Float32Array, mask: BoolArray, size_px: int) -> float:
    """Return how far single pixels lie from the mean of their box on average, m; an edge counts like noise at most."""
    smooth = smooth_height(height, mask, size_px)
    valid = mask & ~np.isnan(height) & (smooth < TOP_M)
    if not valid.any():
        return 0.0
    return float(np.minimum(np.abs(height - smooth)[valid], np.float32(MAX_SCATTER_M)).mean())


def _tile_mean(tensor: Float32Array, counted: BoolArray, mm_per_px: float) -> Float64Array:
    """Return the (3,) trimmed mean over the tiles of ``counted``; that of a cloth just flat if these are too few."""
    from scipy.stats import trim_mean  # slow to import

    side = max(1, round(TILE_MM / mm_per_px))
    shape = (-(-counted.shape[1] // side), -(-counted.shape[0] // side))
    share, *sums = (
        cv2.resize(np.where(counted, part, np.float32(0)), shape, interpolation=cv2.INTER_AREA)
        for part in (np.ones(counted.shape, np.float32), *tensor)
    )
    full = share > 0.5
    if np.count_nonzero(full) < MIN_TILES:
        return np.array([0.5, 0.0, 0.5]) * MIN_STRENGTH**2
    return np.array([trim_mean(part[full] / share[full], TRIMMED) for part in sums], dtype=np.float64)
