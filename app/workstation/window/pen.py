"""Pen: lines, balls, arrows and the table of the world, drawn into a picture of a camera."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from layflat.app.media import cloth_colors as colors
from layflat.app.media.cloth_colors import Rgb
from layflat.app.workstation.window.orbit_camera import NEAR_M, OrbitCamera
from layflat.data.arrays import FloatArray
from layflat.sim.camera.renderer import LIGHT
from layflat.sim.physics.base import TABLE_CENTRE_M, TABLE_SIZE_M

SHIFT = 4
"""Fractional bits of drawing coordinates."""
GRID_M = 0.1
EDGE: Rgb = (36, 42, 52)
AXIS: Rgb = (112, 124, 142)
_CENTRE_M, _HALF_M = np.array([*TABLE_CENTRE_M, 0.0]), np.array([*TABLE_SIZE_M[:2], 0.0]) / 2
TABLE_M = (_CENTRE_M - _HALF_M, _CENTRE_M + _HALF_M)
"""Opposite corners of the table's top, (3,) m."""


def fixed(pixels: FloatArray) -> NDArray[np.int32]:
    """Return drawing coordinates, clipped far outside the picture, where OpenCV's integers would overflow."""
    made: NDArray[np.int32] = np.rint(np.clip(pixels, -8000, 12000) * 2**SHIFT).astype(np.int32)
    return made


@dataclass(frozen=True)
class Pen:
    """A picture (H, W, 3), the camera that sees it, and px of the picture for each px of thickness."""

    picture: NDArray[np.uint8]
    camera: OrbitCamera
    scale: float = 1.0

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture, px."""
        return self.picture.shape[1], self.picture.shape[0]

    def _px(self, length: float) -> int:
        return max(round(length * self.scale), 1)

    def path(self, points: FloatArray, rgb: Rgb, thick: float) -> None:
        """Draw a line through points (K, 3) m."""
        pixels, depth = self.camera.project(points, self.size)
        if depth.min() > NEAR_M:
            cv2.polylines(self.picture, [fixed(pixels)], False, rgb, self._px(thick), cv2.LINE_AA, SHIFT)

    def line(self, a: ArrayLike, b: ArrayLike, rgb: Rgb, thick: float) -> None:
        """Draw a line, cut where it is behind the eye."""
        points = clipped(np.array([a, b], dtype=float), self.camera)
        if len(points) >= 2:
            self.path(points[[0, -1]], rgb, thick)

    def ring(self, at: FloatArray, radius: float, rgb: Rgb, thick: float) -> None:
        """Draw a ring of ``radius`` px at scale 1 around a point."""
        pixel, depth = self.camera.project(at, self.size)
        if depth[0] > NEAR_M:
            x, y = fixed(pixel)[0].tolist()
            cv2.circle(self.picture, (x, y), self._px(radius) << SHIFT, rgb, self._px(thick), cv2.LINE_AA, SHIFT)

    def ball(self, centre: FloatArray, radius_m: float, rgb: Rgb) -> None:
        """Draw a ball with a dark rim, at least 2 px large."""
        pixel, depth = self.camera.project(centre, self.size)
        if depth[0] < NEAR_M:
            return
        radius = max(self._px(2), round(radius_m / depth[0] * self.size[1] * 1.45))
        x, y = fixed(pixel)[0].tolist()
        dark = tuple(int(0.45 * value) for value in rgb)
        cv2.circle(self.picture, (x, y), radius << SHIFT, dark, -1, cv2.LINE_AA, SHIFT)
        lift = int(0.22 * radius) << SHIFT
        cv2.circle(self.picture, (x + lift // 2, y - lift), int(0.72 * radius) << SHIFT, rgb, -1, cv2.LINE_AA, SHIFT)

    def arrow(self, tail: ArrayLike, head: ArrayLike, rgb: Rgb, thick: float) -> None:
        """Draw an arrow."""
        (a, b), depth = self.camera.project(np.array([tail, head], dtype=float), self.size)
        if depth.min() < NEAR_M or np.linalg.norm(b - a) < self._px(2):
            return
        length = float(np.linalg.norm(b - a))
        start, end = (np.rint(p).astype(int).tolist() for p in (a, b))
        cv2.arrowedLine(
            self.picture, start, end, rgb, self._px(thick), cv2.LINE_AA, 0, min(0.45, 12 * self.scale / length)
        )

    def ground(self) -> None:
        """Draw the table and its grid, with x = 0 and y = 0 brighter."""
        low, high = TABLE_M
        top = np.array([[low[0], low[1], 0], [high[0], low[1], 0], [high[0], high[1], 0], [low[0], high[1], 0]])
        for depth_m, rgb in ((TABLE_SIZE_M[2] / 2, EDGE), (0.0, colors.TABLE)):
            points = clipped(np.vstack([top, top[:1]]) - [0, 0, depth_m], self.camera)
            if len(points) >= 3:
                pixels = self.camera.project(points, self.size)[0]
                cv2.fillConvexPoly(self.picture, cv2.convexHull(fixed(pixels)), rgb, cv2.LINE_AA, SHIFT)
        for axis in (0, 1):
            for at in np.arange(np.ceil(low[axis] / GRID_M), high[axis] / GRID_M + 1e-9) * GRID_M:
                ends = np.array([low, high])
                ends[:, axis] = at
                self.line(ends[0], ends[1], AXIS if abs(at) < 1e-9 else colors.GRID, 1)


def on_table(points: FloatArray) -> FloatArray:
    """Return where the light through ``points`` meets the table."""
    cast: FloatArray = points - np.maximum(points[:, 2:], 0.0) / LIGHT[2] * LIGHT
    return np.clip(cast, *TABLE_M)


def clipped(path: FloatArray, camera: OrbitCamera) -> FloatArray:
    """Return the path (K, 3) without points behind NEAR_M, and with points where it crosses that plane."""
    depth = (camera.eye() - path) @ camera.axes()[2] - NEAR_M
    kept: list[FloatArray] = []
    for k in range(len(path)):
        if k and (depth[k] > 0) != (depth[k - 1] > 0):
            share = depth[k - 1] / (depth[k - 1] - depth[k])
            kept.append(path[k - 1] + share * (path[k] - path[k - 1]) + 1e-6)
        if depth[k] > 0:
            kept.append(path[k])
    return np.array(kept).reshape(-1, 3)
