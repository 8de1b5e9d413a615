"""The camera's image laid on the table plane: a map in millimetres with +x to the right and +y up.

In this view a pixel means the same area of table wherever the cloth lies in a tilted camera's image, so that the two
pixel counts of Eq. 4-7 can be compared, directions come out in table coordinates, and the Gabor wavelength is a length
on the cloth. What lies above the table is displaced away from the camera (parallax); only what is near it counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from layflat.perception.camera.pinhole import WHOLE, PinholeCamera, Window
from layflat.perception.errors import PerceptionError

BoolArray: TypeAlias = NDArray[np.bool_]

_NOWHERE = -1e4
"""Pixel coordinate outside every image, for parts of the table behind the camera."""

MOST_SEEN_PX = 1_000_000
"""Pixels of a grid that is made for a view: 2.5 m x 2.5 m at 2.5 mm."""


@dataclass(frozen=True, kw_only=True)
class TableGrid:
    """A rectangle of the table cut into square pixels: column -> +x, row 0 at the largest y.

    By default what the bench's camera sees of it: a cloth that is pulled flat walks as far as y = 0.39 m.
    """

    x_min: float = -0.25
    x_max: float = 0.80
    y_min: float = -0.40
    y_max: float = 0.40
    mm_per_px: float = 2.5

    def __post_init__(self) -> None:
        if not (self.x_max > self.x_min and self.y_max > self.y_min and self.mm_per_px > 0):
            raise PerceptionError(f"{self} is empty; it needs x_min < x_max, y_min < y_max and mm_per_px > 0")
        if self.width * self.height > 4_000_000:
            raise PerceptionError(f"{self} has {self.width}x{self.height} px; is mm_per_px in millimetres?")

    @property
    def metres_per_px(self) -> float:
        return self.mm_per_px / 1000.0

    @property
    def width(self) -> int:
        """Columns."""
        return max(1, round((self.x_max - self.x_min) / self.metres_per_px))

    @property
    def height(self) -> int:
        """Rows."""
        return max(1, round((self.y_max - self.y_min) / self.metres_per_px))

    @property
    def pixel_to_table(self) -> NDArray[np.float64]:
        """(3, 3) affine map from a grid pixel's centre (column, row, 1) to the table (x, y, 1), m."""
        step = self.metres_per_px
        return np.array([[step, 0.0, self.x_min + step / 2], [0.0, -step, self.y_max - step / 2], [0.0, 0.0, 1.0]])

    def to_table(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Grid pixels (N, 2) (column, row) -> table coordinates (N, 2) (x, y), m."""
        affine = self.pixel_to_table
        return np.asarray(pixels, dtype=np.float64).reshape(-1, 2) @ affine[:2, :2].T + affine[:2, 2]

    def to_pixel(self, points: ArrayLike) -> NDArray[np.float64]:
        """Table coordinates (N, 2) (x, y) in m -> grid pixels (N, 2) (column, row), not rounded."""
        affine = self.pixel_to_table
        return (np.asarray(points, dtype=np.float64).reshape(-1, 2) - affine[:2, 2]) / np.diag(affine)[:2]


class TableRectifier:
    """Resamples camera images into a table grid; the maps are made once."""

    def __init__(self, camera: PinholeCamera, grid: TableGrid) -> None:
        self.camera = camera
        self.grid = grid
        self.grid_to_image = camera.table_to_pixel @ grid.pixel_to_table
        """(3, 3) homography from grid pixels to camera pixels."""
        column, row = np.meshgrid(np.arange(grid.width), np.arange(grid.height))
        u, v, depth = np.tensordot(self.grid_to_image, np.stack([column, row, np.ones_like(row)]), axes=1)
        ahead = depth > 1e-6
        safe = np.where(ahead, depth, 1.0)
        u = np.where(ahead, u / safe, _NOWHERE).clip(_NOWHERE, -_NOWHERE)
        v = np.where(ahead, v / safe, _NOWHERE).clip(_NOWHERE, -_NOWHERE)
        # Fixed-point maps resample about twice as fast as float ones; their step is 1/32 of a camera pixel.
        self._maps = cv2.convertMaps(u.astype(np.float32), v.astype(np.float32), cv2.CV_16SC2)

    def rectify(self, image: NDArray[Any], window: Window = WHOLE) -> NDArray[Any]:
        """Image (H, W) or (H, W, 3) of the camera -> the grid's ``window`` of it, bilinear; 0 beyond the image."""
        if image.shape[:2] != (self.camera.height, self.camera.width):
            raise PerceptionError(
                f"image has shape {image.shape}; this camera's are {(self.camera.height, self.camera.width)}"
            )
        whole, fraction = self._maps
        return cv2.remap(image, whole[window], fraction[window], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)

    def window_of(self, mask: BoolArray) -> Window | None:
        """The grid's rows and columns that can show any of a mask (H, W) of the camera; None where it shows nothing."""
        box = bounding_window(mask, margin=1)
        if box is None:
            return None
        (top, bottom), (left, right) = ((part.start, part.stop - 1) for part in box)
        corners = np.array([(u, v, 1.0) for u in (left, right) for v in (top, bottom)])
        column, row, scale = np.linalg.solve(self.grid_to_image, corners.T)
        if not (scale > 0).all():  # the box reaches the horizon
            return WHOLE
        rows, columns = _span(row / scale, self.grid.height), _span(column / scale, self.grid.width)
        return (rows, columns) if rows.stop > rows.start and columns.stop > columns.start else None

    def rectify_mask(self, mask: BoolArray, window: Window = WHOLE) -> BoolArray:
        """Mask (H, W) of the camera -> the grid's ``window`` of it: True where more than half a pixel is covered."""
        return self.rectify(mask.astype(np.uint8) * np.uint8(255), window) > 127


@dataclass(frozen=True, kw_only=True, eq=False)
class ClothView:
    """What a descriptor is given: the part of the table view that holds the cloth."""

    rgb: NDArray[np.uint8]
    """(h, w, 3)"""
    cloth: BoolArray
    """(h, w): the cloth's silhouette."""
    contact: BoolArray
    """(h, w): where it lies on the table."""
    height: NDArray[np.float32]
    """(h, w) m above the table, smoothed; means something on the cloth only."""
    mm_per_px: float

    def __post_init__(self) -> None:
        shape = self.cloth.shape
        if self.rgb.shape != (*shape, 3) or self.contact.shape != shape or self.height.shape != shape:
            raise PerceptionError(
                f"rgb {self.rgb.shape}, cloth {shape}, contact {self.contact.shape} and height {self.height.shape} "
                "must show the same pixels"
            )


def grid_around(
    camera: PinholeCamera, cloth: BoolArray, *, mm_per_px: float = 2.5, margin_m: float = 0.1, reach_m: float = 4.0
) -> TableGrid:
    """A grid that holds what the pixels of ``cloth`` (H, W) cover on the table, and ``margin_m`` on each side.

    Pixels that meet the table farther than ``reach_m`` from the camera's foot, or never, show lifted cloth before what
    is far away; they take no part. Pixels of ``mm_per_px``, or a power of two larger where there would be too many.
    """
    rows, columns = np.nonzero(cloth)
    x, y, nearness = np.linalg.inv(camera.table_to_pixel) @ np.stack([columns, rows, np.ones(len(rows))])
    ahead = nearness > 1e-6
    points = np.column_stack([x[ahead], y[ahead]]) / nearness[ahead, None]
    points = points[np.linalg.norm(points - camera.position[:2], axis=1) < reach_m]
    if len(points) == 0:
        raise PerceptionError(f"no cloth is seen before the table within {reach_m} m of the camera")
    (x_min, y_min), (x_max, y_max) = points.min(axis=0) - margin_m, points.max(axis=0) + margin_m
    while (x_max - x_min) * (y_max - y_min) / (mm_per_px / 1000) ** 2 > MOST_SEEN_PX:
        mm_per_px *= 2
    return TableGrid(x_min=x_min, x_max=x_max, y_min=y_min, y_max=y_max, mm_per_px=mm_per_px)


def bounding_window(mask: BoolArray, margin: int = 0) -> Window | None:
    """Rows and columns that hold all of ``mask``, widened by ``margin`` px within the image; None if it is empty."""
    column, row, width, height = cv2.boundingRect(mask.view(np.uint8))
    if width == 0 or height == 0:
        return None
    return (
        slice(max(0, row - margin), min(mask.shape[0], row + height + margin)),
        slice(max(0, column - margin), min(mask.shape[1], column + width + margin)),
    )


def _span(values: NDArray[np.float64], size: int) -> slice:
    """The whole numbers from the least to the greatest of ``values``, within 0..size."""
    low, high = np.clip([math.floor(values.min()), math.ceil(values.max()) + 1], 0, size)
    return slice(int(low), int(high))


def touches_border(mask: BoolArray) -> bool:
    """True if any pixel on the outermost rows or columns is set."""
    return bool(mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any())
