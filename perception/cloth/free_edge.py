"""Position of the free (lowest) edge of a hanging cloth, from the camera alone."""

from __future__ import annotations

import numpy as np

from layflat.perception.arrays import BoolArray, Float64Array, FloatArray
from layflat.perception.camera.pinhole import PinholeCamera

LOWEST_SHARE = 0.05
"""Share of the cloth's pixels that count as its free edge: some hundred, so that the depth noise averages out."""
MIN_PIXELS = 20


def free_edge(camera: PinholeCamera, cloth: BoolArray, depth: FloatArray) -> Float64Array | None:
    """Return the mean position (3,) of the lowest LOWEST_SHARE of the visible cloth, world, m.

    ``cloth`` (H, W) and ``depth`` (H, W) m along the optical axis, 0 where missing, are camera images. The result is
    None where fewer than MIN_PIXELS have a depth.
    """
    rows, columns = np.nonzero(cloth & (depth > 0))
    if len(rows) < MIN_PIXELS:
        return None
    along = depth[rows, columns]
    height = along * camera.rise_per_depth[rows, columns] + camera.position[2]
    count = max(MIN_PIXELS, round(LOWEST_SHARE * len(rows)))
    low = np.argpartition(height, count - 1)[:count]
    points = camera.back_project(np.column_stack([columns[low], rows[low]]), along[low])
    return np.asarray(points.mean(axis=0))
