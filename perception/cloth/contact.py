"""Height of the cloth over the table: contact (thesis 3-1-2), contact portion (Eq. 4-7), and the free edge."""

from __future__ import annotations

import cv2
import numpy as np

from layflat.perception.arrays import BoolArray, Float32Array, Float64Array, FloatArray
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.errors import PerceptionError

MIN_HEIGHT_M = -0.02
"""Lower heights are errors of the depth sensor; clipped so that one of them cannot spoil a mean."""
MAX_HEIGHT_M = 0.06
"""Higher cloth is equally far from contact; clipped for the same reason."""
SUNKEN_M = -0.05
"""No sensor errs by this much: a cloth mostly below it has depth in other units or another camera pose."""
MAX_STRETCH = 1.06
"""Largest area of a stretched cloth over its area at rest. The simulated cloths, laid by two corners, reach 1.03 to
1.06; a cloth that seems larger is not the one that P_flat was counted with."""

LOWEST_SHARE = 0.05
"""Share of the cloth's pixels that count as its free edge: some hundred, so that the depth noise averages out."""
MIN_PIXELS = 20


def smooth_height(height: Float32Array, cloth: BoolArray, size_px: int = 5) -> Float32Array:
    """Return (h, w) the mean height, m, of the valid cloth pixels in a box of ``size_px`` around each pixel.

    ``height`` is NaN where the sensor has no value. The table around the cloth is left out, so that it does not lower a
    lifted rim. A pixel without a value in its box takes the nearest: missing depth is filled, never read as "no
    contact". Defined on the cloth and one pixel around it, MAX_HEIGHT_M elsewhere.
    """
    valid = cloth & ~np.isnan(height)
    n_valid = np.count_nonzero(valid)
    if n_valid == 0 and cloth.any():
        raise PerceptionError("no cloth pixel has a depth value; is the depth in metres, with 0 for missing?")
    n_sunken = np.count_nonzero(height[valid] < SUNKEN_M)
    if 2 * n_sunken > n_valid:
        raise PerceptionError(
            f"{n_sunken} of {n_valid} cloth pixels lie more than {-SUNKEN_M} m below the table; "
            "is the depth in metres along the optical axis, and does cam_to_world fit the camera?"
        )
    values = np.where(valid, height, np.float32(0)).clip(MIN_HEIGHT_M, MAX_HEIGHT_M)
    box = (size_px, size_px)
    count = cv2.boxFilter(valid.astype(np.float32), -1, box, normalize=False, borderType=cv2.BORDER_CONSTANT)
    total = cv2.boxFilter(values, -1, box, normalize=False, borderType=cv2.BORDER_CONSTANT)
    known = count > 0.5
    smooth = np.where(known, total / np.maximum(count, np.float32(1)), np.float32(MAX_HEIGHT_M))
    wanted = cv2.dilate(cloth.view(np.uint8), np.ones((3, 3), np.uint8)).view(np.bool_)
    holes = wanted & ~known
    if holes.any():
        smooth[holes] = _fill_from_nearest(smooth, known)[holes]
    return smooth


def _fill_from_nearest(values: Float32Array, known: BoolArray) -> Float32Array:
    """Return each pixel's value from the nearest known pixel."""
    unknown = (~known).astype(np.uint8)
    _, labels = cv2.distanceTransformWithLabels(unknown, cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL)
    by_label = np.zeros(int(labels.max()) + 1, dtype=np.float32)
    by_label[labels[known]] = values[known]
    return np.asarray(by_label[labels], dtype=np.float32)


def contact_mask(cloth: BoolArray, height: Float32Array, max_height_m: float) -> BoolArray:
    """Return (h, w) the cloth no higher than ``max_height_m`` above the table; ``height`` from ``smooth_height``."""
    return cloth & (height <= np.float32(max_height_m))


def covered_pixels(cloth: BoolArray, height: Float32Array, *, contact_height_m: float, camera_height_m: float) -> float:
    """Return how many pixels ``cloth`` (h, w) of the rectified view would have with no part above contact height.

    Raised cloth is nearer to the camera and drawn larger: a tenth of the area more at 4 cm. ``height`` (h, w) as for
    ``contact_mask``.
    """
    rise = np.maximum(height[cloth] - np.float32(contact_height_m), np.float32(0))
    shrink = 1 - rise / np.float32(max(camera_height_m - contact_height_m, MAX_HEIGHT_M))
    return float(shrink @ shrink)


def contact_portion(contact_pixels: int, *, covered: float, flat_pixels: int) -> float:
    """Return Eq. 4-7, C = P_contact / P_flat, with P_flat corrected for stretch.

    A cloth held by two corners is stretched: by Eq. 4-7 to the letter its contact reads 1 while parts of it still stand
    up. Where more cloth is visible than P_flat, C = P_contact / ``covered``, up to MAX_STRETCH. The result exceeds 1
    only for another cloth than that of ``flat_pixels``. All counts are of the same rectified view.
    """
    if flat_pixels <= 0:
        raise PerceptionError(f"flat_pixels is {flat_pixels}; it must be the positive pixel count of the flat cloth")
    return contact_pixels / min(max(flat_pixels, covered), MAX_STRETCH * flat_pixels)


def free_edge(camera: PinholeCamera, cloth: BoolArray, depth: FloatArray) -> Float64Array | None:
    """Return the mean position (3,) of the lowest LOWEST_SHARE of the visible cloth, world, m.

    ``cloth`` and ``depth`` (H, W) are camera images; None where fewer than MIN_PIXELS have a depth.
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
