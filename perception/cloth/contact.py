"""Where the cloth lies on the table (thesis 3-1-2, contact detection) and how much of it does (Eq. 4-7)."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.perception.camera.rectified_view import BoolArray
from layflat.perception.errors import PerceptionError

LOWEST_M = -0.02
"""Heights below are a depth sensor's errors; clipped so that one of them cannot spoil a mean."""
SUNKEN_M = -0.05
"""No sensor errs by so much: a cloth mostly below this was measured in other units or from another place."""
HIGHEST_M = 0.06
"""Heights above are all equally far from contact; clipped for the same reason."""
MOST_STRETCH = 1.06
"""Area of a stretched cloth / area of the same cloth at rest, at most. The bench's cloths, laid by two corners, come to
1.03 to 1.06; a cloth that seems to be larger still is another one than P_flat was counted with."""


def smooth_height(height: NDArray[np.float32], cloth: BoolArray, size_px: int = 5) -> NDArray[np.float32]:
    """(h, w) m: mean height of the valid cloth pixels in a box of ``size_px`` around each pixel.

    ``height`` (h, w) is NaN where the sensor has no value. The table around the cloth takes no part, so a lifted rim is
    not drawn down. A cloth pixel with no value in its box takes that of the nearest pixel that has one: missing depth
    is filled, never read as "no contact". Defined on the cloth and one pixel around it, HIGHEST_M elsewhere.
    """
    valid = cloth & ~np.isnan(height)
    seen = np.count_nonzero(valid)
    if seen == 0 and cloth.any():
        raise PerceptionError("no cloth pixel has a depth value; is the depth in metres, with 0 for missing?")
    below = np.count_nonzero(height[valid] < SUNKEN_M)
    if 2 * below > seen:
        raise PerceptionError(
            f"{below} of {seen} cloth pixels lie more than {-SUNKEN_M} m below the table; "
            "is the depth in metres along the optical axis, and does cam_to_world fit the camera?"
        )
    values = np.where(valid, height, np.float32(0)).clip(LOWEST_M, HIGHEST_M)
    box = (size_px, size_px)
    count = cv2.boxFilter(valid.astype(np.float32), -1, box, normalize=False, borderType=cv2.BORDER_CONSTANT)
    total = cv2.boxFilter(values, -1, box, normalize=False, borderType=cv2.BORDER_CONSTANT)
    known = count > 0.5
    smooth = np.where(known, total / np.maximum(count, np.float32(1)), np.float32(HIGHEST_M))
    wanted = cv2.dilate(cloth.view(np.uint8), np.ones((3, 3), np.uint8)).view(np.bool_)
    holes = wanted & ~known
    if holes.any():
        smooth[holes] = _nearest(smooth, known)[holes]
    return smooth


def contact_mask(cloth: BoolArray, height: NDArray[np.float32], below_m: float) -> BoolArray:
    """(h, w): cloth no higher than ``below_m`` above the table; ``height`` without NaN, from ``smooth_height``."""
    return cloth & (height <= np.float32(below_m))


def covered_pixels(cloth: BoolArray, height: NDArray[np.float32], *, level_m: float, camera_m: float) -> float:
    """How many pixels ``cloth`` (h, w) of the table view would count if no part of it were higher than ``level_m``.

    What stands up is nearer to the camera, which is ``camera_m`` above the table, and is drawn larger: a tenth of the
    area more at 4 cm. ``height`` (h, w) as for ``contact_mask``.
    """
    rise = np.maximum(height[cloth] - np.float32(level_m), np.float32(0))
    shrink = 1 - rise / np.float32(max(camera_m - level_m, HIGHEST_M))
    return float(shrink @ shrink)


def contact_portion(contact_pixels: int, *, covered: float, flat_pixels: int) -> float:
    """Eq. 4-7, C = P_contact / P_flat, P_flat as large as the cloth has become; counted in the same table view.

    A cloth held by two corners is stretched, and a stretched cloth covers more pixels than P_flat: by Eq. 4-7 to the
    letter its contact reads 1 while parts of it still stand up. Whoever sees more cloth than P_flat sees the stretch,
    so then C = P_contact / ``covered_pixels``, up to MOST_STRETCH. Above 1 only if it is not the cloth of
    ``flat_pixels``.
    """
    if flat_pixels <= 0:
        raise PerceptionError(f"flat_pixels is {flat_pixels}; it must be the positive pixel count of the flat cloth")
    return contact_pixels / min(max(flat_pixels, covered), MOST_STRETCH * flat_pixels)


def _nearest(values: NDArray[np.float32], known: BoolArray) -> NDArray[np.float32]:
    """Each pixel's value from the nearest pixel that is known."""
    unknown = (~known).astype(np.uint8)
    _, labels = cv2.distanceTransformWithLabels(unknown, cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL)
    by_label = np.zeros(int(labels.max()) + 1, dtype=np.float32)
    by_label[labels[known]] = values[known]
    return np.asarray(by_label[labels], dtype=np.float32)
