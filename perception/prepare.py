"""What every descriptor does to a view before it looks for wrinkles: brightness, relief, and where responses count."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.tableview import BoolArray


def relative_brightness(rgb: NDArray[np.uint8], cloth: BoolArray) -> NDArray[np.float32]:
    """(h, w): each pixel's share along the cloth's mean colour; 1 on average over the cloth.

    For a cloth of one colour this is the grey image with the least noise, whatever the colour.
    """
    colour = np.array(cv2.mean(rgb, cloth.view(np.uint8))[:3])
    power = float(colour @ colour)
    if power == 0.0:
        return np.ones(cloth.shape, dtype=np.float32)
    return np.asarray(cv2.transform(rgb.astype(np.float32), (colour / power)[None, :]), dtype=np.float32)


def filled(image: NDArray[np.float32], inside: BoolArray, reach_px: float, beyond: float) -> NDArray[np.float32]:
    """The image inside; outside, the mean of what is inside within about ``reach_px``, or ``beyond`` where none is.

    So that the outline of the cloth is not a wrinkle.
    """
    box = (2 * round(reach_px / 2) + 1,) * 2
    share = cv2.boxFilter(inside.astype(np.float32), -1, box, borderType=cv2.BORDER_CONSTANT)
    less = image - np.float32(beyond)
    mean = cv2.boxFilter(np.where(inside, less, np.float32(0)), -1, box, borderType=cv2.BORDER_CONSTANT)
    outside = np.float32(beyond) + mean / np.maximum(share, np.float32(1e-3))
    return np.where(inside, image, outside).astype(np.float32)


def eroded(mask: BoolArray, radius_px: float) -> BoolArray:
    """Without the pixels nearer than ``radius_px`` to the outside or to the view's border."""
    if round(radius_px) == 0:
        return mask
    return cv2.erode(mask.view(np.uint8), _disc(radius_px), borderType=cv2.BORDER_CONSTANT, borderValue=0).view(
        np.bool_
    )


def dilated(mask: BoolArray, radius_px: float) -> BoolArray:
    """With the pixels nearer than ``radius_px`` to it."""
    if round(radius_px) == 0:
        return mask
    return cv2.dilate(mask.view(np.uint8), _disc(radius_px)).view(np.bool_)


def _disc(radius_px: float) -> NDArray[np.uint8]:
    side = 2 * round(radius_px) + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), dtype=np.uint8)
