"""Array types and mask operations that the whole package shares."""

from __future__ import annotations

from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.floating[Any]]
Float32Array: TypeAlias = NDArray[np.float32]
Float64Array: TypeAlias = NDArray[np.float64]
BoolArray: TypeAlias = NDArray[np.bool_]
RgbArray: TypeAlias = NDArray[np.uint8]
"""(H, W, 3) image."""
Window: TypeAlias = tuple[slice, slice]
"""Rows and columns of an image."""

WHOLE: Window = (slice(None), slice(None))


def bounding_window(mask: BoolArray, margin: int = 0) -> Window | None:
    """Return the window that holds all of ``mask``, widened by ``margin`` px within the image; None if it is empty."""
    column, row, width, height = cv2.boundingRect(mask.view(np.uint8))
    if width == 0 or height == 0:
        return None
    return (
        slice(max(0, row - margin), min(mask.shape[0], row + height + margin)),
        slice(max(0, column - margin), min(mask.shape[1], column + width + margin)),
    )


def touches_border(mask: BoolArray) -> bool:
    """Return True if any pixel on the outermost rows or columns is set."""
    return bool(mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any())


def erode(mask: BoolArray, radius_px: float) -> BoolArray:
    """Remove the pixels nearer than ``radius_px`` to the outside or to the image's border."""
    if round(radius_px) == 0:
        return mask
    eroded = cv2.erode(mask.view(np.uint8), _disc(radius_px), borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return eroded.view(np.bool_)


def dilate(mask: BoolArray, radius_px: float) -> BoolArray:
    """Add the pixels nearer than ``radius_px`` to the mask."""
    if round(radius_px) == 0:
        return mask
    return cv2.dilate(mask.view(np.uint8), _disc(radius_px)).view(np.bool_)


def _disc(radius_px: float) -> NDArray[np.uint8]:
    side = 2 * round(radius_px) + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), dtype=np.uint8)
