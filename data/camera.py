"""CameraModel: the pinhole camera of recorded images, with its pose."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from layflat.data.arrays import FloatArray, frozen_array
from layflat.data.errors import DataError

AXES = "x right, y down, z forward (OpenCV); pixel (0, 0) is the centre of the top left pixel"
SIDE_MAX = 1 << 16
"""Most pixels along a side of an image."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraModel:
    """A pinhole camera without distortion; ``layflat.perception.camera.pinhole.PinholeCamera`` has the same fields."""

    width: int
    height: int
    fx: float
    """Focal length along columns, px."""
    fy: float
    """Focal length along rows, px."""
    cx: float
    """Column of the optical axis, px."""
    cy: float
    """Row of the optical axis, px."""
    cam_to_world: FloatArray
    """(4, 4) rigid transform from camera axes (x right, y down, z forward) to the world, m."""

    def __post_init__(self) -> None:
        pose = frozen_array(self.cam_to_world, (4, 4), "cam_to_world")
        object.__setattr__(self, "cam_to_world", pose)
        if not (0 < self.width <= SIDE_MAX and 0 < self.height <= SIDE_MAX):
            raise DataError(f"the camera's image is {self.width}x{self.height} px; sides are 1 to {SIDE_MAX}")
        numbers = (self.fx, self.fy, self.cx, self.cy)
        if not all(math.isfinite(value) for value in numbers) or min(self.fx, self.fy) <= 0:
            raise DataError(f"the camera's fx, fy, cx, cy are {numbers}; they must be finite and the first two above 0")
        turn = pose[:3, :3]
        rigid = np.allclose(turn @ turn.T, np.eye(3), atol=1e-5) and np.linalg.det(turn) > 0
        if not rigid or pose[3].tolist() != [0, 0, 0, 1]:
            raise DataError(f"cam_to_world is {pose.tolist()}; it must be a rotation and a translation")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, CameraModel) and self.to_json() == other.to_json()

    def __hash__(self) -> int:
        return hash(self.to_json())

    def points(self, depth: FloatArray) -> FloatArray:
        """Return the world point of each pixel, (H, W, 3) m; NaN where ``depth``, (H, W) or (H, W, 1) m, is missing."""
        z = np.asarray(depth, dtype=np.float64).reshape(self.height, self.width, 1)
        z = np.where((z > 0) & (z < np.inf), z, np.nan)
        slopes = np.ones((self.height, self.width, 3))
        slopes[..., 0] = (np.arange(self.width) - self.cx) / self.fx
        slopes[..., 1] = ((np.arange(self.height) - self.cy) / self.fy)[:, np.newaxis]
        world: FloatArray = slopes * z @ self.cam_to_world[:3, :3].T + self.cam_to_world[:3, 3]
        return world

    def to_json(self) -> str:
        """Return the camera as a JSON object, for files."""
        values = {**vars(self), "cam_to_world": self.cam_to_world.tolist(), "depth_unit": "m", "axes": AXES}
        return json.dumps(values)

    @classmethod
    def from_json(cls, text: str) -> CameraModel:
        """Return the camera of a JSON object of a file that cannot be trusted; DataError where it is damaged."""
        try:
            values: Any = json.loads(text)
            sides = {key: values[key] for key in ("width", "height")}
            numbers = {key: values[key] for key in ("fx", "fy", "cx", "cy")}
            if any(type(side) is not int for side in sides.values()) or values["depth_unit"] != "m":
                raise TypeError
            floats = {key: float(value) for key, value in numbers.items() if type(value) in (int, float)}
            return cls(**sides, **floats, cam_to_world=values["cam_to_world"])  # type: ignore[arg-type]
        except DataError:
            raise
        except (ValueError, LookupError, TypeError, RecursionError, OverflowError):
            raise DataError(
                f"camera is {text[:60]!r}; it must be a JSON object with width, height, fx, fy, cx, cy, cam_to_world"
                " (4x4) and depth_unit m"
            ) from None
