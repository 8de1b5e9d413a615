"""Colour of the cloth from the image itself: learned around a pixel, or that of its pixels."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np

from layflat.perception.arrays import BoolArray, Float32Array, RgbArray, Window
from layflat.perception.cloth.segmentation import HsvRange, segment
from layflat.perception.errors import PerceptionError

GREY = 0.18
"""Saturation below which a camera's hue is noise, or the white balance's."""
DARK = 0.10
"""Value below which hue is noise."""
MIN_COLORED_SHARE = 0.3
"""Share of the pixels around a point that must have a colour."""
SHADED_SATURATION = 0.65
"""Share of a surface's saturation that its shaded and its glossy parts keep."""
HUE_REACH = 18.0
"""Degrees from the cloth's hue within which its pixels are searched."""
HUE_MARGIN, HUE_MIN_REACH, HUE_MAX_REACH = 8.0, 14.0, 40.0
"""Widening of a range on each side, and its smallest and largest extent on each side of the middle, degrees. A reverse
side or coloured light from the side differs by 5 to 10."""
MIN_AREA_SHARE = 0.002
"""Smallest share of the image that a cloth covers."""
ONE_COLOR_SHARE = 0.85
"""Share of a cloth that must lie in its range of colour."""


class _Hsv(NamedTuple):
    """Hue in degrees, saturation and value in 0..1, each (H, W)."""

    hue: Float32Array
    saturation: Float32Array
    value: Float32Array

    @classmethod
    def from_rgb(cls, rgb: RgbArray) -> _Hsv:
        hsv = cv2.cvtColor(rgb.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2HSV)
        return cls(*(np.asarray(channel, np.float32) for channel in cv2.split(hsv)))

    def colored(self, part: Window | tuple[()] = ()) -> BoolArray:
        """Return the pixels that have a hue."""
        return np.asarray((self.saturation[part] > GREY) & (self.value[part] > DARK))


def learn_hsv(rgb: RgbArray, at: tuple[int, int]) -> HsvRange:
    """Return the colour range of the uniform piece of an image (H, W, 3) that holds pixel ``at`` (column, row).

    Shade changes the value most, the saturation less and the hue hardly. The range is wider than the sample.
    """
    height, width = rgb.shape[:2]
    column, row = at
    if not (0 <= column < width and 0 <= row < height):
        raise PerceptionError(f"point {column},{row} is outside the image, which is {width}x{height} px")
    hsv = _Hsv.from_rgb(rgb)
    radius = max(2, round(width / 200))
    patch = (slice(max(0, row - radius), row + radius + 1), slice(max(0, column - radius), column + radius + 1))
    colored = hsv.colored(patch)
    if colored.mean() < MIN_COLORED_SHARE:
        saturation, value = np.median(hsv.saturation[patch]), np.median(hsv.value[patch])
        raise PerceptionError(
            f"the colour at {column},{row} is {'black' if value < DARK else 'grey'} (saturation {saturation:.2f}, "
            f"value {value:.2f}) and has no hue to find the cloth by: at least {GREY} and {DARK} are needed"
        )
    region = _uniform_piece(hsv, patch, colored)
    share = np.count_nonzero(region) / region.size
    if share < MIN_AREA_SHARE:
        raise PerceptionError(
            f"the colour at {column},{row} covers {100 * share:.2f} % of the image there; a cloth covers at least "
            f"{100 * MIN_AREA_SHARE:.1f} %: point at the middle of its surface"
        )
    return _range_of(hsv, region)


def range_of_cloth(rgb: RgbArray, mask: BoolArray) -> HsvRange | None:
    """Return the colour range that finds the pixels of ``mask`` (H, W); None for white, grey, black and prints."""
    hsv = _Hsv.from_rgb(rgb)
    colored = mask & hsv.colored()
    if np.count_nonzero(colored) < ONE_COLOR_SHARE * np.count_nonzero(mask):
        return None
    color = _range_of(hsv, colored)
    found = segment(rgb, color) & mask
    return color if np.count_nonzero(found) > ONE_COLOR_SHARE * np.count_nonzero(mask) else None


def name_color(rgb: RgbArray, mask: BoolArray) -> str:
    """Return the everyday name of the colour of most pixels of ``mask`` (H, W)."""
    if not mask.any():
        return "no colour"
    hue, saturation, value = (np.asarray(channel)[mask] for channel in _Hsv.from_rgb(rgb))
    colored = (saturation > GREY) & (value > DARK)
    middle = float(np.median(value))
    if np.mean(colored) < 0.4 or middle < 0.2:
        return next(name for limit, name in ((0.25, "black"), (0.6, "grey"), (2.0, "white")) if middle < limit)
    centre = _mean_hue(hue[colored])
    near = np.abs(_hue_difference(hue[colored] - np.float32(centre))) < HUE_MAX_REACH
    return hue_name(centre) if np.count_nonzero(near) > 0.6 * len(value) else "many-coloured"


def hue_name(degrees: float) -> str:
    """Return the everyday name of a hue."""
    names = ("red", "orange", "yellow", "green", "green", "green", "cyan", "blue", "blue", "violet", "magenta", "pink")
    return names[math.floor((degrees % 360.0 + 15.0) / 30.0) % len(names)]


def _hue_difference(degrees: Float32Array) -> Float32Array:
    """Wrap differences of hue to -180..180."""
    return np.asarray((degrees + 180.0) % 360.0 - 180.0, dtype=np.float32)


def _mean_hue(hue: Float32Array) -> float:
    from scipy.stats import circmean  # slow to import

    return float(circmean(hue, high=360.0))


def _uniform_piece(hsv: _Hsv, patch: Window, colored: BoolArray) -> BoolArray:
    """Return the connected pixels with the colour of the patch's ``colored`` pixels, lit or shaded, that touch it."""
    centre = _mean_hue(hsv.hue[patch][colored])
    min_saturation = max(0.7 * GREY, SHADED_SATURATION * float(np.median(hsv.saturation[patch][colored])))
    min_value = max(0.5 * DARK, 0.25 * float(np.median(hsv.value[patch][colored])))
    alike = np.abs(_hue_difference(hsv.hue - centre)) < HUE_REACH
    alike &= (hsv.saturation > min_saturation) & (hsv.value > min_value)
    _, labels = cv2.connectedComponents(cv2.medianBlur(alike.astype(np.uint8), 5), connectivity=8)
    touched = np.bincount(labels[patch].ravel())
    touched[0] = 0
    label = int(np.argmax(touched))
    return (labels == label) & (label > 0)


def _range_of(hsv: _Hsv, region: BoolArray) -> HsvRange:
    """Return the range that holds 98 of 100 pixels of the region, widened."""
    centre = _mean_hue(hsv.hue[region])
    low, high = np.percentile(_hue_difference(hsv.hue[region] - centre), [1, 99])
    low = float(np.clip(low - HUE_MARGIN, -HUE_MAX_REACH, -HUE_MIN_REACH))
    high = float(np.clip(high + HUE_MARGIN, HUE_MIN_REACH, HUE_MAX_REACH))
    saturation, value = (np.percentile(channel[region], 1) for channel in (hsv.saturation, hsv.value))
    return HsvRange(
        hue_min=round((centre + low) % 360.0, 1),
        hue_max=round((centre + high) % 360.0, 1),
        saturation_min=round(float(np.clip(0.75 * saturation, 0.7 * GREY, 0.8)), 3),
        value_min=round(float(np.clip(0.5 * value, 0.5 * DARK, 0.5)), 3),
    )
