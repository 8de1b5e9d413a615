"""Where the cloth is lowest: of a hanging cloth its free edge, by the camera alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from layflat.perception.camera.pinhole import FloatArray, PinholeCamera
from layflat.perception.camera.rectified_view import BoolArray

SHARE = 0.05
"""Of the cloth's pixels that count as its lowest part: some hundred, so that the noise of the depth averages out."""
LEAST_PX = 20


def free_edge(camera: PinholeCamera, cloth: BoolArray, depth: FloatArray) -> NDArray[np.float64] | None:
    """(3,) m, world: mean place of the lowest SHARE of the seen cloth; None where fewer than LEAST_PX have a depth.

    ``cloth`` (H, W) and ``depth`` (H, W) m along the optical axis, 0 where missing, are in the camera's image.
    """
    rows, columns = np.nonzero(cloth & (depth > 0))
    if len(rows) < LEAST_PX:
        return None
    along = depth[rows, columns]
    height = along * camera.rise_per_depth[rows, columns] + camera.position[2]
    count = max(LEAST_PX, round(SHARE * len(rows)))
    low = np.argpartition(height, count - 1)[:count]
    points = camera.back_project(np.column_stack([columns[low], rows[low]]), along[low])
    place: NDArray[np.float64] = points.mean(axis=0)
    return place
