"""Parts of a cloth whose wrinkles run one way each, for a cloth whose wrinkles run several ways."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage

from layflat.perception.arrays import BoolArray, Float32Array, Float64Array
from layflat.perception.cloth.relief import Relief, Wrinkles

CELL_MM = 15.0
"""Side of the cells that are put together to regions."""
SPREAD_MM = 24.0
"""Standard deviation of the window in which a cell's direction is found: one wrinkle and what lies beside it."""
REACH_MM = 200.0
"""So far apart cells of one direction are as unlike as cells at the same place that differ by 30 degrees."""
MAX_WARD = 6.0
"""Regions are put together (Ward's method) up to this distance: 25 cells each that are one unit apart make 3.5."""
MIN_AREA_MM2 = 2500.0
MIN_SHARE = 0.03
"""Smallest region, mm2 and share of the cloth."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WrinkleRegion:
    """Part of the cloth whose wrinkles run one way."""

    wrinkles: Wrinkles
    mask: BoolArray
    """(h, w) in the relief's grid."""
    place_m: Float64Array
    """(2,) table coordinates, m: the point of the region that is nearest to its centre."""
    share: float
    """Share of the cloth's area, without the rim that does not count."""


def wrinkle_regions(relief: Relief) -> list[WrinkleRegion]:
    """Return the parts of the cloth that have a direction, the largest first; they do not overlap."""
    return sorted(_regions(relief), key=lambda region: -region.share)


def _regions(relief: Relief) -> Iterator[WrinkleRegion]:
    inner = relief.inner
    total, pixel_mm2 = np.count_nonzero(inner), relief.grid.mm_per_px**2
    labels = _label_cells(relief)
    for label in range(1, int(labels.max()) + 1):
        mask = inner & (labels == label)
        area = np.count_nonzero(mask)
        if area * pixel_mm2 < MIN_AREA_MM2 or area < MIN_SHARE * total:
            continue
        wrinkles = relief.wrinkles(mask)
        if wrinkles.has_direction:
            rows, columns = np.nonzero(mask)
            nearest = int(np.argmin((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2))
            place_m = relief.grid.to_table([columns[nearest], rows[nearest]])[0]
            yield WrinkleRegion(wrinkles=wrinkles, mask=mask, place_m=place_m, share=area / total)


def _label_cells(relief: Relief) -> Float64Array:
    """Return (h, w) the number of each pixel's region, 0 outside the cloth."""
    from sklearn.cluster import AgglomerativeClustering  # slow to import
    from sklearn.feature_extraction.image import grid_to_graph

    shape, side = relief.inner.shape, max(1, round(CELL_MM / relief.grid.mm_per_px))
    rows, columns = (np.arange(side // 2, size, side) for size in shape)
    axes, labels = _local_axes(relief)[:, rows][:, :, columns], np.zeros((len(rows), len(columns)))
    pieces, count = ndimage.label(relief.inner[np.ix_(rows, columns)])
    for piece in range(1, count + 1):
        cells = pieces == piece
        if np.count_nonzero(cells) * CELL_MM**2 < MIN_AREA_MM2 / 2:
            continue
        place = np.argwhere(cells) * (CELL_MM / REACH_MM)
        graph = grid_to_graph(*cells.shape, mask=cells)
        ward = AgglomerativeClustering(n_clusters=None, distance_threshold=MAX_WARD, connectivity=graph)
        labels[cells] = labels.max() + 1 + ward.fit_predict(np.hstack([axes[:, cells].T, place]))
    near = [np.minimum(np.arange(size) // side, count - 1) for size, count in zip(shape, labels.shape, strict=True)]
    return np.asarray(labels[np.ix_(*near)])


def _local_axes(relief: Relief) -> Float32Array:
    """Return (2, h, w) the doubled-angle vector of the slopes around each pixel; its length is their coherence."""
    sigma = SPREAD_MM / relief.grid.mm_per_px
    xx, xy, yy = (
        cv2.GaussianBlur(np.where(relief.inner, part, np.float32(0)), (0, 0), sigma) for part in relief.tensor
    )
    return np.asarray(np.stack([xx - yy, 2 * xy]) / np.maximum(xx + yy, np.float32(1e-12)), dtype=np.float32)
