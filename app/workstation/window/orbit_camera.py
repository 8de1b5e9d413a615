"""OrbitCamera: a camera that the mouse turns around the table: orbit, zoom, pan, and the ray behind a pixel."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from layflat.data.arrays import FloatArray

FIELD_DEG = 38.0
"""Field of view across the height."""
NEAR_M = 0.05
TURN_RAD_PER_PX = 0.008
ZOOM_PER_STEP = 1.12
DISTANCE_M = (0.35, 4.0)
ELEVATION_RAD = (math.radians(4), math.radians(89))
REACH_M = (np.array([-0.4, -0.7, 0.0]), np.array([1.0, 0.7, 0.7]))
"""Corners of the box within which the target may be panned."""


@dataclass(frozen=True, kw_only=True)
class OrbitCamera:
    """Place and direction of the view. Angles in rad: azimuth 0 is from +x, counter-clockwise seen from above."""

    target: tuple[float, float, float] = (0.20, 0.06, 0.29)
    azimuth: float = math.radians(-42)
    elevation: float = math.radians(26)
    distance: float = 1.85

    def turned(self, dx_px: float, dy_px: float) -> OrbitCamera:
        """Return the camera after the mouse has turned the scene by so much."""
        low, high = ELEVATION_RAD
        elevation = min(max(self.elevation + dy_px * TURN_RAD_PER_PX, low), high)
        return replace(self, azimuth=self.azimuth - dx_px * TURN_RAD_PER_PX, elevation=elevation)

    def zoomed(self, steps: float) -> OrbitCamera:
        """Return the camera nearer by so many clicks of the wheel."""
        low, high = DISTANCE_M
        return replace(self, distance=min(max(self.distance * ZOOM_PER_STEP**-steps, low), high))

    def panned(self, dx_px: float, dy_px: float, height_px: int) -> OrbitCamera:
        """Return the camera moved so that its target follows the mouse."""
        right, up, _ = self.axes()
        metres = 2 * self.distance * math.tan(math.radians(FIELD_DEG) / 2) / height_px
        moved = np.clip(np.array(self.target) - metres * (dx_px * right - dy_px * up), *REACH_M)
        return replace(self, target=(float(moved[0]), float(moved[1]), float(moved[2])))

    def axes(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return unit vectors in the world: to the image's right, up in the image, and out of the image to the eye."""
        return _axes(self.azimuth, self.elevation)

    def eye(self) -> FloatArray:
        """Return the place of the eye, (3,) m, world."""
        return np.array(self.target) + self.distance * self.axes()[2]

    def project(self, points: ArrayLike, size: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
        """Return pixels (N, 2) of world points (N, 3) in a picture of (width, height), and their depths (N,) m.

        Points nearer than NEAR_M, or behind the eye, get a pixel, too: check their depth.
        """
        right, up, back = self.axes()
        away = np.asarray(points, dtype=float).reshape(-1, 3) - self.eye()
        depth = -away @ back
        scale = focal_px(size[1]) / np.maximum(depth, NEAR_M)
        pixels = np.stack([size[0] / 2 + scale * (away @ right), size[1] / 2 - scale * (away @ up)], axis=1)
        return pixels, depth

    def ray(self, pixel: tuple[float, float], size: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
        """Return origin (3,) m and unit direction (3,) of the line of sight behind a pixel."""
        right, up, back = self.axes()
        focal = focal_px(size[1])
        along = (pixel[0] - size[0] / 2) / focal * right - (pixel[1] - size[1] / 2) / focal * up - back
        return self.eye(), along / np.linalg.norm(along)

    def dragged(self, point: FloatArray, dx_px: float, dy_px: float, height_px: int) -> FloatArray:
        """Return ``point``, (3,) m, after the mouse has moved it in the plane that faces the eye."""
        right, up, back = self.axes()
        metres = float((self.eye() - point) @ back) / focal_px(height_px)
        return point + metres * (dx_px * right - dy_px * up)


PRESETS = {
    "reset": OrbitCamera(),
    "side": OrbitCamera(azimuth=math.radians(-90), elevation=math.radians(4), target=(0.20, 0.0, 0.25), distance=1.5),
    "top": OrbitCamera(azimuth=math.radians(-90), elevation=math.radians(89), target=(0.25, 0.0, 0.0), distance=1.5),
    "front": OrbitCamera(azimuth=0.0, elevation=math.radians(8), target=(0.20, 0.0, 0.25), distance=1.5),
}
"""Views by name: side along +y with +x to the right, top from above with +x to the right, front along -x."""


@lru_cache(maxsize=8)
def _axes(azimuth: float, elevation: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    ca, sa, ce, se = (f(v) for v in (azimuth, elevation) for f in (math.cos, math.sin))
    back = np.array([ce * ca, ce * sa, se])
    right = np.array([-sa, ca, 0.0])
    return right, np.cross(back, right), back


def focal_px(height_px: int) -> float:
    """Return the focal length for a picture of that height, px."""
    return height_px / 2 / math.tan(math.radians(FIELD_DEG) / 2)
