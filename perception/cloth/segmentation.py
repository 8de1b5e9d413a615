"""Segmentation of the cloth by a range of hue, saturation and value (thesis 3-1-2)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.perception.arrays import BoolArray, RgbArray, bounding_window
from layflat.perception.errors import PerceptionError


@dataclass(frozen=True, kw_only=True)
class HsvRange:
    """Colours of the cloth. The default is a saturated blue, lit or in its own shade."""

    hue_min: float = 195.0
    """Degrees, 0..360; red 0, green 120, blue 240."""
    hue_max: float = 255.0
    """Degrees, 0..360; below ``hue_min`` the range goes through 0 (a red cloth: 340 to 20)."""
    saturation_min: float = 0.35
    """0 (grey) .. 1."""
    value_min: float = 0.10
    """0 (black) .. 1; hue is noise at lower values."""

    def __post_init__(self) -> None:
        if not (0 <= self.hue_min <= 360 and 0 <= self.hue_max <= 360):
            raise PerceptionError(f"hue range {self.hue_min}..{self.hue_max} is not within 0..360 degrees")
        if not (0 <= self.saturation_min <= 1 and 0 <= self.value_min <= 1):
            raise PerceptionError(
                f"saturation_min {self.saturation_min} and value_min {self.value_min} must lie within 0..1"
            )

    def bounds(self) -> list[tuple[tuple[int, int, int], tuple[int, int, int]]]:
        """Return corners for ``cv2.inRange`` (hue in half degrees 0..179): a lower and upper pair, two across 0."""
        low, high = round(self.hue_min / 2), round(self.hue_max / 2)
        rest = (round(self.saturation_min * 255), round(self.value_min * 255))
        spans = [(low, high)] if low <= high else [(low, 180), (0, high)]
        return [((first, *rest), (last, 255, 255)) for first, last in spans]


def segment(rgb: RgbArray, color: HsvRange, min_area_px: int = 40) -> BoolArray:
    """Return the cloth mask (H, W) of an image (H, W, 3).

    A 5x5 majority vote closes pinholes and removes single pixels. Pieces smaller than ``min_area_px`` are taken for
    reflections and dropped.
    """
    hsv = cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV)
    mask = np.zeros(rgb.shape[:2], dtype=np.uint8)
    for lower, upper in color.bounds():
        mask |= np.asarray(cv2.inRange(hsv, np.array(lower), np.array(upper)), dtype=np.uint8)
    window = bounding_window(mask > 0, margin=2)
    if window is None:
        return mask > 0
    cloth = np.zeros(mask.shape, dtype=np.bool_)
    cloth[window] = _drop_specks(np.asarray(cv2.medianBlur(mask[window], 5), dtype=np.uint8), min_area_px)
    return cloth


def _drop_specks(mask: NDArray[np.uint8], min_area_px: int) -> BoolArray:
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    keep = stats[:, cv2.CC_STAT_AREA] >= min_area_px
    keep[0] = False  # label 0 is the background
    if count == 1 or keep[1:].all():
        return mask > 0
    return np.asarray(keep[labels], dtype=np.bool_)
