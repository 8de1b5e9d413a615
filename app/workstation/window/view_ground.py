"""Table and its grid in the 3D view."""

from __future__ import annotations

import cv2
import numpy as np

from layflat.app.media import cloth_colors as colors
from layflat.app.media.cloth_colors import Rgb
from layflat.app.workstation.window.view_pen import SHIFT, Pen, clipped, fixed
from layflat.data.arrays import FloatArray
from layflat.sim.camera.renderer import LIGHT
from layflat.sim.physics.base import TABLE_CENTRE_M, TABLE_SIZE_M

GRID_M = 0.1
EDGE: Rgb = (36, 42, 52)
AXIS: Rgb = (112, 124, 142)


def draw_ground(pen: Pen) -> None:
    """Draw the table and its grid, with x = 0 and y = 0 brighter."""
    low, high = _table_box()
    top = np.array([[low[0], low[1], 0], [high[0], low[1], 0], [high[0], high[1], 0], [low[0], high[1], 0]])
    for depth_m, rgb in ((TABLE_SIZE_M[2] / 2, EDGE), (0.0, colors.TABLE)):
        _plane(pen, top - [0, 0, depth_m], rgb)
    for axis in (0, 1):
        for at in np.arange(np.ceil(low[axis] / GRID_M), high[axis] / GRID_M + 1e-9) * GRID_M:
            ends = np.array([low, high])
            ends[:, axis] = at
            pen.line(ends[0], ends[1], AXIS if abs(at) < 1e-9 else colors.GRID, 1)


def _plane(pen: Pen, corners: FloatArray, rgb: Rgb) -> None:
    """Draw a convex polygon, cut where it is behind the eye."""
    points = clipped(np.vstack([corners, corners[:1]]), pen.camera)
    if len(points) >= 3:
        pixels = pen.camera.project(points, pen.size)[0]
        cv2.fillConvexPoly(pen.picture, cv2.convexHull(fixed(pixels)), rgb, cv2.LINE_AA, SHIFT)


def on_table(points: FloatArray) -> FloatArray:
    """Return where the light through ``points`` meets the table."""
    cast: FloatArray = points - np.maximum(points[:, 2:], 0.0) / LIGHT[2] * LIGHT
    return np.clip(cast, *_table_box())


def _table_box() -> tuple[FloatArray, FloatArray]:
    half = np.array([TABLE_SIZE_M[0] / 2, TABLE_SIZE_M[1] / 2, 0.0])
    centre = np.array([*TABLE_CENTRE_M, 0.0])
    return centre - half, centre + half
