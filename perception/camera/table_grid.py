"""Grid of square pixels on the table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from layflat.perception.arrays import BoolArray, Float64Array
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.errors import PerceptionError

MAX_PIXELS = 4_000_000
MAX_FITTED_PIXELS = 1_000_000
"""Largest grid that ``grid_around`` makes: 2.5 m x 2.5 m at 2.5 mm."""


@dataclass(frozen=True, kw_only=True)
class TableGrid:
    """Rectangle of the table, m, cut into square pixels: column -> +x, row 0 at the largest y.

    The default is what the simulated camera sees of the table: a cloth that is pulled flat moves as far as y = 0.39 m.
    """

    x_min: float = -0.25
    x_max: float = 0.80
    y_min: float = -0.40
    y_max: float = 0.40
    mm_per_px: float = 2.5

    def __post_init__(self) -> None:
        if not (self.x_max > self.x_min and self.y_max > self.y_min and self.mm_per_px > 0):
            raise PerceptionError(f"{self} is empty; it needs x_min < x_max, y_min < y_max and mm_per_px > 0")
        if self.width * self.height > MAX_PIXELS:
            raise PerceptionError(f"{self} has {self.width}x{self.height} px; is mm_per_px in millimetres?")

    @property
    def metres_per_px(self) -> float:
        """Side of a pixel, m."""
        return self.mm_per_px / 1000.0

    @property
    def width(self) -> int:
        """Number of columns."""
        return max(1, round((self.x_max - self.x_min) / self.metres_per_px))

    @property
    def height(self) -> int:
        """Number of rows."""
        return max(1, round((self.y_max - self.y_min) / self.metres_per_px))

    @property
    def pixel_to_table(self) -> Float64Array:
        """(3, 3) affine map from a pixel's centre (column, row, 1) to the table (x, y, 1), m."""
        step = self.metres_per_px
        return np.array([[step, 0.0, self.x_min + step / 2], [0.0, -step, self.y_max - step / 2], [0.0, 0.0, 1.0]])

    def to_table(self, pixels: ArrayLike) -> Float64Array:
        """Return the table coordinates (N, 2) (x, y), m, of pixels (N, 2) (column, row)."""
        affine = self.pixel_to_table
        return np.asarray(pixels, dtype=np.float64).reshape(-1, 2) @ affine[:2, :2].T + affine[:2, 2]

    def to_pixel(self, points: ArrayLike) -> Float64Array:
        """Return the pixels (N, 2) (column, row), not rounded, of table coordinates (N, 2) (x, y), m."""
        affine = self.pixel_to_table
        return (np.asarray(points, dtype=np.float64).reshape(-1, 2) - affine[:2, 2]) / np.diag(affine)[:2]


def grid_around(
    camera: PinholeCamera, cloth: BoolArray, *, mm_per_px: float = 2.5, margin_m: float = 0.1, reach_m: float = 4.0
) -> TableGrid:
    """Return a grid that holds what the pixels of ``cloth`` (H, W) cover on the table, with a margin on each side.

    Pixels that meet the table beyond ``reach_m`` from the camera's foot, or never, show lifted cloth and are ignored.
    ``mm_per_px`` is doubled until the grid has at most MAX_FITTED_PIXELS.
    """
    rows, columns = np.nonzero(cloth)
    x, y, nearness = np.linalg.inv(camera.table_to_pixel) @ np.stack([columns, rows, np.ones(len(rows))])
    ahead = nearness > 1e-6
    points = np.column_stack([x[ahead], y[ahead]]) / nearness[ahead, None]
    points = points[np.linalg.norm(points - camera.position[:2], axis=1) < reach_m]
    if len(points) == 0:
        raise PerceptionError(f"no cloth is seen in front of the table within {reach_m} m of the camera")
    (x_min, y_min), (x_max, y_max) = points.min(axis=0) - margin_m, points.max(axis=0) + margin_m
    while (x_max - x_min) * (y_max - y_min) / (mm_per_px / 1000) ** 2 > MAX_FITTED_PIXELS:
        mm_per_px *= 2
    return TableGrid(x_min=x_min, x_max=x_max, y_min=y_min, y_max=y_max, mm_per_px=mm_per_px)
