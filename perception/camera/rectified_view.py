"""Rectified (bird's-eye) view: the camera's image resampled into a table grid, +x to the right and +y up.

A pixel then means the same area of table wherever the cloth lies: the pixel counts of Eq. 4-7 can be compared,
directions are in table coordinates, and the Gabor wavelength is a length on the cloth. What lies above the table is
displaced away from the camera (parallax).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.perception.arrays import WHOLE, BoolArray, Float32Array, Float64Array, RgbArray, Window, bounding_window
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.camera.table_grid import TableGrid
from layflat.perception.errors import PerceptionError

_OUTSIDE = 1e4
"""Pixel coordinate outside every image, for parts of the table behind the camera."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ClothView:
    """Part of the rectified view that holds the cloth: the input of a descriptor. All arrays have (h, w) pixels."""

    rgb: RgbArray
    cloth: BoolArray
    """Silhouette of the cloth."""
    contact: BoolArray
    """Cloth that lies on the table."""
    height: Float32Array
    """Smoothed height above the table, m; meaningful on the cloth only."""
    mm_per_px: float

    def __post_init__(self) -> None:
        shape = self.cloth.shape
        if self.rgb.shape != (*shape, 3) or self.contact.shape != shape or self.height.shape != shape:
            raise PerceptionError(
                f"rgb {self.rgb.shape}, cloth {shape}, contact {self.contact.shape} and height {self.height.shape} "
                "must show the same pixels"
            )

    def crop(self, window: Window) -> ClothView:
        """Return a window of the view."""
        return replace(self, **{name: getattr(self, name)[window] for name in ("rgb", "cloth", "contact", "height")})


class TableRectifier:
    """Resamples camera images into a table grid. The pixel maps are computed once."""

    def __init__(self, camera: PinholeCamera, grid: TableGrid) -> None:
        self.camera = camera
        self.grid = grid
        self.grid_to_image: Float64Array = camera.table_to_pixel @ grid.pixel_to_table
        """(3, 3) homography from grid pixels to camera pixels."""
        column, row = np.meshgrid(np.arange(grid.width), np.arange(grid.height))
        u, v, depth = np.tensordot(self.grid_to_image, np.stack([column, row, np.ones_like(row)]), axes=1)
        ahead = depth > 1e-6
        safe = np.where(ahead, depth, 1.0)
        u, v = (np.where(ahead, axis / safe, -_OUTSIDE).clip(-_OUTSIDE, _OUTSIDE) for axis in (u, v))
        # Fixed-point maps resample about twice as fast as float ones; their step is 1/32 of a camera pixel.
        self._maps = cv2.convertMaps(u.astype(np.float32), v.astype(np.float32), cv2.CV_16SC2)

    def rectify(self, image: NDArray[Any], window: Window = WHOLE) -> NDArray[Any]:
        """Resample a camera image (H, W) or (H, W, 3) into the grid's ``window``, bilinear; 0 beyond the image."""
        if image.shape[:2] != (self.camera.height, self.camera.width):
            raise PerceptionError(
                f"image has shape {image.shape}; this camera's are {(self.camera.height, self.camera.width)}"
            )
        whole, fraction = self._maps
        return cv2.remap(image, whole[window], fraction[window], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)

    def rectify_mask(self, mask: BoolArray, window: Window = WHOLE) -> BoolArray:
        """Resample a camera mask (H, W) into the grid's ``window``: True where more than half a pixel is covered."""
        return self.rectify(mask.astype(np.uint8) * np.uint8(255), window) > 127

    def grid_window(self, mask: BoolArray) -> Window | None:
        """Return the grid's window that can show any of a camera mask (H, W); None where it shows nothing."""
        box = bounding_window(mask, margin=1)
        if box is None:
            return None
        (top, bottom), (left, right) = ((part.start, part.stop - 1) for part in box)
        corners = np.array([(u, v, 1.0) for u in (left, right) for v in (top, bottom)])
        column, row, scale = np.linalg.solve(self.grid_to_image, corners.T)
        if not (scale > 0).all():  # the box reaches the horizon
            return WHOLE
        rows, columns = _integer_span(row / scale, self.grid.height), _integer_span(column / scale, self.grid.width)
        return (rows, columns) if rows.stop > rows.start and columns.stop > columns.start else None


def _integer_span(values: Float64Array, size: int) -> slice:
    """Return the slice from the smallest to the largest of ``values``, rounded outwards, within 0..size."""
    low, high = np.clip([math.floor(values.min()), math.ceil(values.max()) + 1], 0, size)
    return slice(int(low), int(high))
