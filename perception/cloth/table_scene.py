"""A reduced frame of a table: what stands off its plane, and which colours are not the table's."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.perception.arrays import BoolArray, Float32Array, FloatArray, RgbArray, dilate
from layflat.perception.camera.intrinsics import Intrinsics
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.cloth.table_colors import cast_shadows, compare_colors

WORK_WIDTH = 320
RAISED_M = (0.004, 0.02)
"""Least and greatest height that counts as raised; between them four times the scatter of the table's height."""
STEP_M = 0.02
"""A step of this height between neighbours parts two surfaces."""
TALL_M, TALL_STEP_M = 0.045, 0.018
"""What is higher, and falls off this steeply all around, is a thing."""
STEEP_RIM = 0.75
"""Share of its outline that is steep: a lifted part of a cloth goes over into the rest."""
FLAT_THING_M, FLAT_STEP_M, FACE_M = 0.014, 0.012, 0.0015
"""A level face (median distance from a plane below FACE_M) this high that falls off this steeply is a thing."""
FACE_SLOPE = 0.25
SHADOWING_M = 0.03
"""What is higher throws a shadow of its own."""
SMALL_THING_PX = 12
MIN_SHARE = 0.002
"""Smallest piece of interest, share of the image."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TableScene:
    """Reduced frame; all arrays have (h, w) pixels."""

    lab: NDArray[np.uint8]
    """(h, w, 3) 8-bit Lab colour."""
    height: Float32Array
    """Height above the plane, m, smoothed but for its steps; 0 where nothing is known nearby."""
    metres_per_px: Float32Array
    raised_m: float
    """Height from which a surface is not the table's."""
    strange: BoolArray
    """Pixels whose colour the table does not have."""
    odd: BoolArray
    """Pixels in whose neighbourhood the colour is not the table's, without its outline."""
    shade: BoolArray
    """Low pixels that may be the table in a shadow."""
    cast: BoolArray
    """Shade on one side of tall things: their shadows."""
    glare: BoolArray
    """Low pixels that may be the table in strong light."""
    cut: BoolArray
    """Steps of height."""
    steepness: Float32Array
    """Range of height within 5x5 pixels, m."""
    things: BoolArray
    """What stands up steeply: bottles, boxes, books, hands."""

    @property
    def raised(self) -> BoolArray:
        """Pixels above the table."""
        return np.asarray(self.height > self.raised_m)


def reduce_frame(rgb: RgbArray, depth: FloatArray, lens: Intrinsics) -> tuple[RgbArray, Float32Array, Intrinsics]:
    """Return the frame at about WORK_WIDTH: mean colours, mean depth of the valid pixels but across edges."""
    factor = max(1, round(lens.width / WORK_WIDTH))
    height, width = rgb.shape[0] // factor, rgb.shape[1] // factor
    size, part = (width, height), depth[: height * factor, : width * factor].astype(np.float32)
    picture = cv2.resize(rgb[: height * factor, : width * factor], size, interpolation=cv2.INTER_AREA)
    total = cv2.resize(part, size, interpolation=cv2.INTER_AREA)
    share = cv2.resize((part > 0).astype(np.float32), size, interpolation=cv2.INTER_AREA)
    mean = np.where(share > 0.3, total / np.maximum(share, np.float32(1e-6)), np.float32(0))
    middle = part[factor // 2 :: factor, factor // 2 :: factor][:height, :width]
    small = np.where(np.abs(mean - middle) > STEP_M, middle, mean)
    cx, cy = ((centre - (factor - 1) / 2) / factor for centre in (lens.cx, lens.cy))
    reduced = Intrinsics(
        width=width,
        height=height,
        fx=lens.fx / factor,
        fy=lens.fy / factor,
        cx=min(max(cx, 0.0), width),
        cy=min(max(cy, 0.0), height),
    )
    return np.asarray(picture, np.uint8), small, reduced


def look_at_table(rgb: RgbArray, depth: Float32Array, camera: PinholeCamera) -> TableScene:
    """Return what a reduced frame shows, seen by a camera over the table's plane."""
    height, smooth = _heights(camera.height_above_table(depth))
    steps = _gradient(height, 3)
    cut = steps > STEP_M
    smooth = np.where(dilate(cut, 1), height, smooth)
    steepness = _gradient(smooth, 5)
    level = np.abs(smooth) < RAISED_M[1]
    scatter = 1.4826 * float(np.median(np.abs(smooth[level]))) if level.any() else 0.0
    raised_m = float(np.clip(4 * scatter, *RAISED_M))
    lab = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2LAB), np.uint8)
    low = smooth < raised_m
    colors = compare_colors(rgb, lab, low & (smooth > -1.5 * raised_m))
    shade = colors.shade & low
    metres_per_px = np.where(depth > 0, depth, camera.position[2]).astype(np.float32) / np.float32(camera.fx)
    return TableScene(
        lab=lab,
        height=smooth,
        metres_per_px=metres_per_px,
        raised_m=raised_m,
        strange=colors.strange,
        odd=colors.odd,
        shade=shade,
        cast=cast_shadows(smooth > SHADOWING_M, shade & (colors.strange | colors.odd)),
        glare=colors.glare & low,
        cut=cut,
        steepness=steepness,
        things=_find_things(smooth, steepness, float(np.median(metres_per_px))),
    )


def is_level_face(height: Float32Array, high: BoolArray, *, least_px: float, px_m: float) -> bool:
    """Return whether the pixels of ``high``, without their rim, are one level face: a book's or a box's.

    ``px_m`` is the side of a pixel, m.
    """
    rows, columns = np.nonzero(cv2.erode(high.astype(np.uint8), np.ones((5, 5), np.uint8)))
    if len(rows) < max(60, least_px):
        return False
    values = height[rows, columns].astype(np.float64)
    basis = np.column_stack([rows, columns, np.ones(len(rows))])
    fit = np.linalg.lstsq(basis, values, rcond=None)[0]
    level = float(np.hypot(*fit[:2])) < FACE_SLOPE * px_m
    return bool(level and np.median(values) > FLAT_THING_M and np.median(np.abs(values - basis @ fit)) < FACE_M)


def outline_of(mask: BoolArray, *, border: int = 0) -> BoolArray:
    """Return the outermost pixels of a mask; those at the image's border count if ``border`` is 0."""
    inner = cv2.erode(
        mask.astype(np.uint8), np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=border
    )
    return mask & (inner == 0)


def fill_holes(mask: BoolArray) -> BoolArray:
    """Return the mask without holes: markers, labels and prints are cloth."""
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return np.asarray(cv2.drawContours(np.zeros(mask.shape, np.uint8), contours, -1, 1, cv2.FILLED) > 0)


def _heights(height: Float32Array) -> tuple[Float32Array, Float32Array]:
    """Return heights without gaps, m: median-filtered, and averaged over 5x5 pixels."""
    known = np.isfinite(height)
    filled = np.where(known, height, np.float32(0)).clip(-0.5, 0.5)
    weight = cv2.blur(known.astype(np.float32), (5, 5))
    smooth = np.where(weight > 0.05, cv2.blur(filled, (5, 5)) / np.maximum(weight, np.float32(1e-6)), np.float32(0))
    sharp = cv2.medianBlur(np.where(known, filled, smooth).astype(np.float32), 5)
    return np.asarray(sharp, np.float32), np.asarray(smooth, np.float32)


def _gradient(height: Float32Array, size: int) -> Float32Array:
    return np.asarray(cv2.morphologyEx(height, cv2.MORPH_GRADIENT, np.ones((size, size), np.uint8)), np.float32)


def _find_things(height: Float32Array, steepness: Float32Array, px_m: float) -> BoolArray:
    """Return what stands up steeply from the table by more than a cloth does, or has a level raised face."""
    things = np.zeros(height.shape, dtype=np.bool_)
    for level, step, connectivity in ((TALL_M, TALL_STEP_M, 8), (FLAT_STEP_M, FLAT_STEP_M, 4)):
        mask = (height > level).astype(np.uint8)
        count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=connectivity)
        least = SMALL_THING_PX if level == TALL_M else MIN_SHARE * height.size
        for label in range(1, count):
            if stats[label, cv2.CC_STAT_AREA] < least:
                continue
            part = labels == label
            rim = outline_of(part, border=1)
            if not rim.any() or np.mean(steepness[rim] > step) < STEEP_RIM:
                continue
            if level == TALL_M:
                things |= fill_holes(part)
            elif is_level_face(height, part, least_px=0.3 * stats[label, cv2.CC_STAT_AREA], px_m=px_m):
                things |= part
    return dilate(things, 2)
