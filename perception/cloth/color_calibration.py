"""The cloth's range of colour from the picture itself: around a pixel that shows it, or from what stands out."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.perception.camera.pinhole import Window
from layflat.perception.camera.rectified_view import BoolArray
from layflat.perception.cloth.segmentation import HsvRange
from layflat.perception.errors import PerceptionError

GREY = 0.18
"""Saturation below which a colour is grey to a camera: its hue is noise, or the white balance's."""
DARK = 0.10
"""Value below which the hue is noise."""
LEAST_OF_PATCH = 0.3
"""Share of the pixels around a point that must have a colour."""
SHADED_SATURATION = 0.65
"""Share of a surface's saturation that its shaded and its glossy parts keep."""
HUE_REACH = 18.0
"""Degrees from its hue within which the cloth's pixels are looked for."""
HUE_MARGIN, HUE_LEAST, HUE_MOST = 8.0, 14.0, 40.0
"""Degrees that a range is widened by on each side of what was seen; the least and the most on each side of its middle.
A reverse side or coloured light from the side differs by 5 to 10."""
SMALLEST_SHARE = 0.002
"""Of the image; a smaller piece of one colour is no cloth."""
BORDER_PENALTY = 20.0
"""How much less a colour is worth that runs along the whole border: that is a table or a floor."""


def learn_hsv(rgb: NDArray[np.uint8], at: tuple[int, int]) -> HsvRange:
    """The range of the piece of one colour that holds pixel ``at`` (column, row) of an image (H, W, 3).

    Shade changes the value most, the saturation less and the hue hardly; the range is as wide as what is seen, and
    somewhat wider.
    """
    height, width = rgb.shape[:2]
    column, row = at
    if not (0 <= column < width and 0 <= row < height):
        raise PerceptionError(f"point {column},{row} is outside the image, which is {width}x{height} px")
    hue, saturation, value = _hsv(rgb)
    radius = max(2, round(width / 200))
    patch = (slice(max(0, row - radius), row + radius + 1), slice(max(0, column - radius), column + radius + 1))
    where = f"the colour at {column},{row}"
    coloured = (saturation[patch] > GREY) & (value[patch] > DARK)
    if coloured.mean() < LEAST_OF_PATCH:
        raise PerceptionError(
            f"{where} is {'black' if np.median(value[patch]) < DARK else 'grey'} (saturation "
            f"{np.median(saturation[patch]):.2f}, value {np.median(value[patch]):.2f}) and has no hue, by which a "
            f"cloth is told from the table: at least {GREY} and {DARK} are needed"
        )
    region = _piece(hue, saturation, value, patch, coloured)
    share = np.count_nonzero(region) / region.size
    if share < SMALLEST_SHARE:
        raise PerceptionError(
            f"{where} covers {100 * share:.2f} % of the image there; a cloth covers at least "
            f"{100 * SMALLEST_SHARE:.1f} %: point at the middle of its surface"
        )
    return _range_of(hue, saturation, value, region)


def suggest_hsv(rgb: NDArray[np.uint8], where: BoolArray | None = None) -> HsvRange:
    """The range of the most saturated, large and compact piece of one colour in an image (H, W, 3).

    ``where`` (H, W) limits the search, for instance to what is on the table. What runs along the image's border is
    taken for the table. A white, grey or black cloth has no hue and is never found.
    """
    hue, saturation, value = (np.asarray(cv2.medianBlur(channel, 5), np.float32) for channel in _hsv(rgb))
    coloured = (saturation > GREY) & (value > DARK)
    if where is not None:
        coloured &= where
    best, best_worth = None, 0.0
    for centre in _hue_peaks(hue[coloured], saturation[coloured]):
        alike = coloured & (np.abs(_turn(hue - centre)) < HUE_REACH)
        # On a wooden table an orange cloth is the more saturated part of one hue.
        for mask in (alike, alike & (saturation > _otsu(saturation[alike]))):
            piece, worth = _best_piece(mask, saturation)
            if worth > best_worth:
                best, best_worth = piece, worth
    if best is None:
        raise PerceptionError(
            "no coloured cloth stands out in the picture; give its colour or a point on it "
            "(a white, grey or black cloth has no hue: use a coloured one)"
        )
    return _range_of(*_hsv(rgb), best)


def _hsv(rgb: NDArray[np.uint8]) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Hue in degrees, saturation and value in 0..1, each (H, W)."""
    hue, saturation, value = cv2.split(cv2.cvtColor(rgb.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2HSV))
    return np.asarray(hue, np.float32), np.asarray(saturation, np.float32), np.asarray(value, np.float32)


def _turn(degrees: NDArray[np.float32] | float) -> NDArray[np.float32]:
    """Differences of hue in -180..180."""
    return np.asarray((degrees + 180.0) % 360.0 - 180.0, dtype=np.float32)


def _mean_hue(hue: NDArray[np.float32]) -> float:
    from scipy.stats import circmean  # slow to import

    return float(circmean(hue, high=360.0))


def _piece(
    hue: NDArray[np.float32],
    saturation: NDArray[np.float32],
    value: NDArray[np.float32],
    patch: Window,
    coloured: BoolArray,
) -> BoolArray:
    """The connected pixels with the colour of the patch's ``coloured`` pixels, lit or shaded, that touch the patch."""
    centre = _mean_hue(hue[patch][coloured])
    least = max(0.7 * GREY, SHADED_SATURATION * float(np.median(saturation[patch][coloured])))
    dim = max(0.5 * DARK, 0.25 * float(np.median(value[patch][coloured])))
    alike = (np.abs(_turn(hue - centre)) < HUE_REACH) & (saturation > least) & (value > dim)
    _, labels = cv2.connectedComponents(cv2.medianBlur(alike.astype(np.uint8), 5), connectivity=8)
    touched = np.bincount(labels[patch].ravel())
    touched[0] = 0
    label = int(np.argmax(touched))
    return (labels == label) & (label > 0)


def _range_of(
    hue: NDArray[np.float32], saturation: NDArray[np.float32], value: NDArray[np.float32], region: BoolArray
) -> HsvRange:
    """What holds 98 of 100 pixels of the region, widened."""
    centre = _mean_hue(hue[region])
    low, high = np.percentile(_turn(hue[region] - centre), [1, 99])
    low = float(np.clip(low - HUE_MARGIN, -HUE_MOST, -HUE_LEAST))
    high = float(np.clip(high + HUE_MARGIN, HUE_LEAST, HUE_MOST))
    return HsvRange(
        hue_min=round((centre + low) % 360.0, 1),
        hue_max=round((centre + high) % 360.0, 1),
        saturation_min=round(float(np.clip(0.75 * np.percentile(saturation[region], 1), 0.7 * GREY, 0.8)), 3),
        value_min=round(float(np.clip(0.5 * np.percentile(value[region], 1), 0.5 * DARK, 0.5)), 3),
    )


def _otsu(values: NDArray[np.float32]) -> float:
    """The value in 0..1 that best parts low from high."""
    level, _ = cv2.threshold(np.rint(255 * values).astype(np.uint8), 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    return float(level) / 255


def _hue_peaks(hue: NDArray[np.float32], saturation: NDArray[np.float32]) -> NDArray[np.float64]:
    """Degrees: the maxima of the hues' histogram, in which a pixel counts as much as it is saturated."""
    from scipy.ndimage import gaussian_filter1d  # slow to import
    from scipy.signal import find_peaks

    bins, width = 72, 5.0
    counts, _ = np.histogram(hue % 360.0, bins=bins, range=(0.0, 360.0), weights=saturation)
    smooth = gaussian_filter1d(counts.astype(np.float64), 1.5, mode="wrap")
    if smooth.max(initial=0.0) <= 0:
        return np.zeros(0)
    lap = np.concatenate([smooth, smooth[:1], smooth[1:2]])  # a peak may stand on the seam
    peaks, _ = find_peaks(np.concatenate([smooth[-1:], lap]), height=0.01 * smooth.max())
    return np.asarray(np.unique((peaks - 1) % bins) * width + width / 2)


def _best_piece(mask: BoolArray, saturation: NDArray[np.float32]) -> tuple[BoolArray | None, float]:
    """The connected piece of ``mask`` that is most like a cloth, and its worth; None where all are too small."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    best, best_worth = None, 0.0
    for label in range(1, count):
        area = int(stats[label, cv2.CC_STAT_AREA])
        if area < SMALLEST_SHARE * mask.size:
            continue
        piece = labels == label
        worth = _worth(piece, area, float(saturation[piece].mean()))
        if worth > best_worth:
            best, best_worth = piece, worth
    return best, best_worth


def _worth(piece: BoolArray, area: int, saturation: float) -> float:
    """Area times saturation, less for what is ragged or runs along the image's border."""
    outlines, _ = cv2.findContours(piece.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    hull = cv2.contourArea(cv2.convexHull(np.concatenate(outlines)))
    compact = min(1.0, area / max(hull, 1.0))
    edges = (piece[0], piece[-1], piece[:, 0], piece[:, -1])
    along = sum(int(np.count_nonzero(edge)) for edge in edges) / sum(edge.size for edge in edges)
    return area * saturation * compact / (1 + BORDER_PENALTY * along)


def hue_name(degrees: float) -> str:
    """A hue's name for people."""
    names = ("red", "orange", "yellow", "green", "green", "green", "cyan", "blue", "blue", "violet", "magenta", "pink")
    return names[math.floor((degrees % 360.0 + 15.0) / 30.0) % len(names)]
