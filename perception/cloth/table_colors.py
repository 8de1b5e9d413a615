"""Colours of a table by the picture's rim: what they do not explain, shadows, strong light."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.perception.arrays import BoolArray, Float32Array, Float64Array, RgbArray, dilate, erode

RIM_SHARE = 0.03
"""Width of the image's rim that shows the table's colours, share of its side."""
SHADE = (0.35, 0.93)
"""Brightness, as a share of the table's, of the table in a shadow."""
GLARE, LIT_CHROMA = 1.05, 6.0
"""Brightness, as a share of the table's, from which strong light may wash its colour out; tolerance of chroma (8-bit
Lab)."""
_BINS = np.array([10.0, 5.0, 5.0], dtype=np.float32)
"""Side of a cell of the colour histogram (8-bit Lab)."""
_COARSE_PX, _COARSE_BINS = 9, np.array([5.0, 4.0, 4.0], dtype=np.float32)
"""Side of a neighbourhood, whose median has little noise and no grain, and of a cell of its histogram."""
_CHROMA = 600.0
"""Levels of a tint, which is the share of red or blue in a colour: shadows do not change it."""
_SHADOW_REACH = 0.25
"""Length of a shadow, share of the image's width, at the least."""


class TableColors(NamedTuple):
    """Pixels (h, w) by what the table's colours say of them."""

    strange: BoolArray
    """The table does not have this colour."""
    odd: BoolArray
    """The table does not have the neighbourhood's colour; without the outline."""
    shade: BoolArray
    """May be the table in a shadow."""
    glare: BoolArray
    """May be the table in strong light."""


def compare_colors(rgb: RgbArray, lab: NDArray[np.uint8], ground: BoolArray) -> TableColors:
    """Compare the colours of a picture with the table's.

    The table's colours are those of its rim in the picture, since a cloth that can be seen whole does not reach there;
    the fall of the light across the picture is taken out first.
    """
    rows, columns = (np.linspace(-1, 1, size, dtype=np.float32) for size in ground.shape)
    x, y = np.broadcast_to(columns, ground.shape), np.broadcast_to(rows[:, None], ground.shape)
    rim = ground & (np.minimum(1 - np.abs(x), 1 - np.abs(y)) < 2 * RIM_SHARE)
    if np.count_nonzero(rim) < 200:
        rim = ground
    if np.count_nonzero(rim) < 200:
        nothing = np.zeros(ground.shape, np.bool_)
        return TableColors(nothing, nothing, nothing, nothing)
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    light = np.log(lab[..., 0].astype(np.float32) + 10)
    trend = basis @ _fit_light(basis[ground], light[ground], np.where(rim[ground], 1.0, 0.15))
    even = np.exp(np.clip(light - trend + float(np.median(trend[rim])), 0, 5.57)) - 10
    far = 1 - 2 * RIM_SHARE
    sides = [rim & side for side in (x < -far, x > far, y < -far, y > far)]
    tints = [128 + _CHROMA * ((rgb[..., i] + 1.0) / (rgb.sum(axis=-1) + 3.0) - 1 / 3) for i in (0, 2)]
    coarse = cv2.medianBlur(np.dstack([even, *tints]).clip(0, 255).astype(np.uint8), _COARSE_PX)
    share = even / max(float(np.median(even[rim])), 1.0)
    tinted = _not_at_rim(coarse * np.array([0, 1, 1], np.uint8), sides, _COARSE_BINS)
    even_chroma, glare = np.ones(ground.shape, np.bool_), share > GLARE
    for channel in (1, 2):
        tint = float(np.median(lab[..., channel][rim])) - 128
        off = lab[..., channel] - np.float32(128)
        even_chroma &= np.abs(off - tint * share) < LIT_CHROMA
        glare &= np.abs(off - np.clip(off, min(0.0, tint), max(0.0, tint))) < LIT_CHROMA
    return TableColors(
        strange=_not_at_rim(np.dstack([even.clip(0, 255), lab[..., 1:]]), sides, _BINS),
        odd=erode(_not_at_rim(coarse, sides, _COARSE_BINS) & ground, 2),
        shade=(share > SHADE[0]) & (share < SHADE[1]) & (even_chroma | ~tinted),
        glare=glare,
    )


def cast_shadows(tall: BoolArray, dark: BoolArray) -> BoolArray:
    """Return the dark pixels on that side of what is tall where most of them are: one lamp throws all shadows."""
    tall = dilate(tall, 6)
    every = cv2.morphologyEx(dark.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    _, labels = cv2.connectedComponents(cv2.morphologyEx(every, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)))
    starts = np.unique(labels[tall & (labels > 0)])
    if len(starts) == 0:
        return np.zeros(dark.shape, np.bool_)
    size = dark.shape[1] // 2, dark.shape[0] // 2
    source, shadows = (
        np.asarray(cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST), np.uint8)
        for mask in (tall, np.isin(labels, starts))
    )
    ways = [_sweep(source, angle) for angle in np.arange(0, 2 * math.pi, math.pi / 12)]
    best = max(ways, key=lambda swept: int(np.count_nonzero(swept & shadows)))
    near = cv2.resize(best, dark.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
    return np.asarray(near & dilate(every > 0, 1))


def _sweep(mask: NDArray[np.uint8], angle: float) -> NDArray[np.uint8]:
    """Return what a mask covers on its way in a direction."""
    size, step = (mask.shape[1], mask.shape[0]), 1
    while step < _SHADOW_REACH * size[0]:
        shift = np.array([[1, 0, step * math.cos(angle)], [0, 1, step * math.sin(angle)]])
        mask = mask | np.asarray(cv2.warpAffine(mask, shift, size, flags=cv2.INTER_NEAREST), np.uint8)
        step *= 2
    return mask


def _not_at_rim(colors: NDArray[Any], sides: list[BoolArray], bins: Float32Array) -> BoolArray:
    """Return the pixels whose colour is not at the picture's rim, given as its four sides."""
    from scipy.ndimage import gaussian_filter  # slow to import

    cells = (colors / bins).astype(np.intp)
    counts = []
    for side in sides:
        count = np.zeros(np.ceil(256 / bins).astype(int), dtype=np.float32)
        np.add.at(count, tuple(cells[side].T), 1)
        counts.append(gaussian_filter(count, (1.2, 0.9, 0.9)))
    usual = np.sum(counts, axis=0) - np.max(counts, axis=0)  # a cloth that is cut shows on one side
    likely = (usual if np.count_nonzero(usual > 0.01) else np.sum(counts, axis=0))[tuple(np.moveaxis(cells, -1, 0))]
    rim = np.logical_or.reduce(sides)
    least = 2e-6 * np.count_nonzero(rim)
    seen = likely[rim & (likely > least)]
    return np.asarray(likely < (max(0.5 * float(np.quantile(seen, 0.01)), least) if len(seen) else least))


def _fit_light(basis: Float32Array, light: Float32Array, weight: Float64Array) -> Float64Array:
    """Return the coefficients of the light's fall, (6,): iterated least squares that leave out other colours."""
    some = slice(None, None, max(1, len(light) // 6000))
    basis, light, weight = basis[some], light[some], weight[some]
    now = weight
    for _ in range(6):
        root = np.sqrt(now)
        fit = np.linalg.lstsq(basis * root[:, None], light * root, rcond=None)[0]
        off = light - basis @ fit
        scatter = 1.4826 * float(np.median(np.abs(off[weight >= 0.5]))) + 0.01
        now = weight / (1 + (off / (2 * scatter)) ** 2) ** 2
    return np.asarray(fit, np.float64)
