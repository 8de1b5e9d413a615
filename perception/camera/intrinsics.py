"""How a camera projects, apart from where it stands: what a RealSense calls the intrinsics."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import NDArray

from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.errors import PerceptionError

D435_FOCAL = 615 / 480
"""Focal length of a D435's colour camera over the image's height: 615 px at 640x480, 922 px at 1280x720. Its 16:9 and
4:3 pictures differ in what they cut off at the sides, so that the height alone decides. Cameras differ by about 1 %."""
FOCAL_RANGE = (0.25, 10.0)
"""Focal length over the longer side of the image: from a fisheye's 127 degrees of view to a telescope's 6."""


@dataclass(frozen=True, kw_only=True)
class Intrinsics:
    """A pinhole without distortion; pixel (0, 0) is the centre of the top left pixel."""

    width: int
    """px"""
    height: int
    """px"""
    fx: float
    """Focal length in pixels along the columns."""
    fy: float
    """Focal length in pixels along the rows."""
    cx: float
    """Column of the optical axis, px."""
    cy: float
    """Row of the optical axis, px."""

    def __post_init__(self) -> None:
        if not all(math.isfinite(value) for value in astuple(self)):
            raise PerceptionError(f"intrinsics {self.numbers} must be finite numbers")
        longer = max(self.width, self.height)
        low, high = (factor * longer for factor in FOCAL_RANGE)
        if not (low <= self.fx <= high and low <= self.fy <= high and 0.5 <= self.fx / self.fy <= 2):
            raise PerceptionError(
                f"intrinsics {self.numbers} cannot be those of a {self.width}x{self.height} image: "
                f"fx and fy must be alike and between {low:.0f} and {high:.0f} px"
            )
        if not (0 <= self.cx <= self.width and 0 <= self.cy <= self.height):
            raise PerceptionError(
                f"intrinsics {self.numbers} cannot be those of a {self.width}x{self.height} image: "
                "cx and cy must lie within it"
            )

    @classmethod
    def d435(cls, width: int, height: int) -> Intrinsics:
        """A D435's colour camera at this size, as its data sheet has it: good to about 1 % of the focal length."""
        focal = D435_FOCAL * height
        return cls(width=width, height=height, fx=focal, fy=focal, cx=(width - 1) / 2, cy=(height - 1) / 2)

    @property
    def numbers(self) -> str:
        """fx,fy,cx,cy as on the command line."""
        return ",".join(f"{value:g}" for value in (self.fx, self.fy, self.cx, self.cy))

    def slopes(self, rows: NDArray, columns: NDArray) -> NDArray[np.float64]:
        """(N, 2) x/z and y/z of the rays through pixels (N,), camera axes."""
        return np.column_stack([(columns - self.cx) / self.fx, (rows - self.cy) / self.fy])

    def at(self, cam_to_world: NDArray[np.float64]) -> PinholeCamera:
        """The camera with this lens at a place."""
        return PinholeCamera(
            width=self.width,
            height=self.height,
            fx=self.fx,
            fy=self.fy,
            cx=self.cx,
            cy=self.cy,
            cam_to_world=cam_to_world,
        )
