"""Camera intrinsics: how a camera projects, apart from its pose."""

from __future__ import annotations

import math
from dataclasses import asdict, astuple, dataclass

import numpy as np
from numpy.typing import NDArray

from layflat.perception.arrays import Float64Array
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.errors import PerceptionError

D435_FOCAL = 615 / 480
"""Focal length of a D435's colour camera over the image height: 615 px at 640x480, 922 px at 1280x720. Its 16:9 and
4:3 images are cut at different widths, so that only the height matters. Cameras differ by about 1 %."""
FOCAL_RANGE = (0.25, 10.0)
"""Focal length over the longer side of the image: from 127 degrees of view (fisheye) to 6 (telephoto)."""


@dataclass(frozen=True, kw_only=True)
class Intrinsics:
    """Pinhole intrinsics without distortion, px: focal lengths and optical axis along columns (x) and rows (y).

    Pixel (0, 0) is the centre of the top left pixel.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        if not all(math.isfinite(value) for value in astuple(self)):
            raise PerceptionError(f"intrinsics {self} must be finite numbers")
        low, high = (factor * max(self.width, self.height) for factor in FOCAL_RANGE)
        wanted = ""
        if not (low <= self.fx <= high and low <= self.fy <= high and 0.5 <= self.fx / self.fy <= 2):
            wanted = f"fx and fy must be alike and between {low:.0f} and {high:.0f} px"
        elif not (0 <= self.cx <= self.width and 0 <= self.cy <= self.height):
            wanted = "cx and cy must lie within it"
        if wanted:
            raise PerceptionError(f"intrinsics {self} cannot be those of a {self.width}x{self.height} image: {wanted}")

    @classmethod
    def d435(cls, width: int, height: int) -> Intrinsics:
        """Return the intrinsics of a D435's colour camera by its data sheet, good to 1 % of the focal length."""
        focal = D435_FOCAL * height
        return cls(width=width, height=height, fx=focal, fy=focal, cx=(width - 1) / 2, cy=(height - 1) / 2)

    def __str__(self) -> str:
        """Return fx,fy,cx,cy as on the command line."""
        return ",".join(f"{value:g}" for value in (self.fx, self.fy, self.cx, self.cy))

    def ray_slopes(self, rows: NDArray, columns: NDArray) -> Float64Array:
        """Return (N, 2) x/z and y/z in camera axes of the rays through pixels ``rows`` (N,) and ``columns`` (N,)."""
        return np.column_stack([(columns - self.cx) / self.fx, (rows - self.cy) / self.fy])

    def camera_at(self, cam_to_world: Float64Array) -> PinholeCamera:
        """Return the camera with these intrinsics at a pose (4, 4)."""
        return PinholeCamera(**asdict(self), cam_to_world=cam_to_world)
