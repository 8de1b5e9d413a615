"""Colour range of the cloth from the image itself: learned around a pixel, or suggested from what stands out."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np

from layflat.perception.arrays import BoolArray, Float32Array, Float64Array, RgbArray, Window
from layflat.perception.cloth.segmentation import HsvRange
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
BORDER_PENALTY = 20.0
"""How strongly a piece loses by running along the image border: that is a table or a floor."""


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


def suggest_hsv(rgb: RgbArray, where: BoolArray | None = None) -> HsvRange:
    """Return the colour range of the most saturated, large and compact uniform piece of an image (H, W, 3).

    ``where`` (H, W) limits the search, for instance to what is on the table. What runs along the image border is taken
    for the table. A white, grey or black cloth has no hue and is never found.
    """
    hsv = _Hsv.from_rgb(rgb)
    smooth = _Hsv(*(np.asarray(cv2.medianBlur(channel, 5), np.float32) for channel in hsv))
    colored = smooth.colored()
    if where is not None:
        colored &= where
    best, best_score = None, 0.0
    for peak in _hue_peaks(smooth.hue[colored], smooth.saturation[colored]):
        alike = colored & (np.abs(_hue_difference(smooth.hue - peak)) < HUE_REACH)
        # On a wooden table an orange cloth is the more saturated part of one hue.
        for mask in (alike, alike & (smooth.saturation > _otsu(smooth.saturation[alike]))):
            piece, score = _best_piece(mask, smooth.saturation)
            if score > best_score:
                best, best_score = piece, score
    if best is None:
        raise PerceptionError(
            "no coloured cloth stands out in the picture; give its colour or a point on it "
            "(a white, grey or black cloth has no hue: use a coloured one)"
        )
    return _range_of(hsv, best)


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


def _otsu(values: Float32Array) -> float:
    """Return the threshold in 0..1 that best separates low from high values."""
    level, _ = cv2.threshold(np.rint(255 * values).astype(np.uint8), 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    return float(level) / 255


def _hue_peaks(hue: Float32Array, saturation: Float32Array) -> Float64Array:
    """Return the maxima, degrees, of the saturation-weighted histogram of hue."""
    from scipy.ndimage import gaussian_filter1d  # slow to import
    from scipy.signal import find_peaks

    bins, width = 72, 5.0
    counts, _ = np.histogram(hue % 360.0, bins=bins, range=(0.0, 360.0), weights=saturation)
    smooth = gaussian_filter1d(counts.astype(np.float64), 1.5, mode="wrap")
    if smooth.max(initial=0.0) <= 0:
        return np.zeros(0)
    wrapped = np.concatenate([smooth[-1:], smooth, smooth[:1], smooth[1:2]])  # a peak may be at the seam
    peaks, _ = find_peaks(wrapped, height=0.01 * smooth.max())
    return np.asarray(np.unique((peaks - 1) % bins) * width + width / 2)


def _best_piece(mask: BoolArray, saturation: Float32Array) -> tuple[BoolArray | None, float]:
    """Return the connected piece of ``mask`` that is most like a cloth, and its score; None if all are too small."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    best, best_score = None, 0.0
    for label in range(1, count):
        area = int(stats[label, cv2.CC_STAT_AREA])
        if area < MIN_AREA_SHARE * mask.size:
            continue
        piece = labels == label
        score = _cloth_score(piece, area, float(saturation[piece].mean()))
        if score > best_score:
            best, best_score = piece, score
    return best, best_score


def _cloth_score(piece: BoolArray, area: int, saturation: float) -> float:
    """Return area times saturation, less for a piece that is ragged or runs along the image border."""
    outlines, _ = cv2.findContours(piece.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    hull = cv2.contourArea(cv2.convexHull(np.concatenate(outlines)))
    compactness = min(1.0, area / max(hull, 1.0))
    edges = (piece[0], piece[-1], piece[:, 0], piece[:, -1])
    border_share = sum(int(np.count_nonzero(edge)) for edge in edges) / sum(edge.size for edge in edges)
    return area * saturation * compactness / (1 + BORDER_PENALTY * border_share)
