"""Where the camera is and how it projects: a pinhole without distortion.

World frame: z up, table top at z = 0, x to the robot's front, y to its left; metres.
Camera axes as in OpenCV: x right, y down, z forward. Pixel (0, 0) is the centre of the top left pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from layflat.perception.errors import PerceptionError

FloatArray: TypeAlias = NDArray[np.floating[Any]]
Window: TypeAlias = tuple[slice, slice]
"""Rows and columns of an image."""

WHOLE: Window = (slice(None), slice(None))


@dataclass(frozen=True, kw_only=True, eq=False)
class PinholeCamera:
    """An ideal camera that looks at the table."""

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
    cam_to_world: NDArray[np.float64]
    """(4, 4) rigid transform from camera axes (x right, y down, z forward) to the world, m."""

    def __post_init__(self) -> None:
        pose = np.array(self.cam_to_world, dtype=np.float64)
        if pose.shape != (4, 4) or not np.isfinite(pose).all() or not np.allclose(pose[3], (0, 0, 0, 1)):
            raise PerceptionError(f"cam_to_world is {pose.tolist()}; it must be a (4, 4) rigid transform")
        rotation = pose[:3, :3]
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-5) or np.linalg.det(rotation) < 0:
            raise PerceptionError("cam_to_world's rotation is not orthonormal and right-handed")
        if self.width < 1 or self.height < 1 or not (self.fx > 0 and self.fy > 0):
            raise PerceptionError(
                f"camera is {self.width}x{self.height} px with fx {self.fx}, fy {self.fy}; all must be positive"
            )
        if pose[2, 3] <= 0:
            raise PerceptionError(f"camera is at z = {pose[2, 3]:.3f} m; it must be above the table (z > 0)")
        pose.setflags(write=False)
        object.__setattr__(self, "cam_to_world", pose)

    @classmethod
    def look_at(
        cls,
        position: ArrayLike,
        target: ArrayLike,
        up: ArrayLike = (0.0, 0.0, 1.0),
        *,
        width: int,
        height: int,
        fx: float,
        fy: float | None = None,
        cx: float | None = None,
        cy: float | None = None,
    ) -> PinholeCamera:
        """A camera at ``position`` whose optical axis meets ``target`` (world, m), ``up`` towards the image's top.

        ``fy`` defaults to ``fx`` (square pixels), the principal point to the image's centre.
        """
        eye = np.asarray(position, dtype=np.float64)
        forward = np.asarray(target, dtype=np.float64) - eye
        right = np.cross(forward, np.asarray(up, dtype=np.float64))
        if np.linalg.norm(right) < 1e-9 * max(1.0, float(np.linalg.norm(forward))):
            raise PerceptionError(
                f"up {up!r} is parallel to the viewing direction {forward.tolist()}; choose another up"
            )
        forward /= np.linalg.norm(forward)
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3, :3] = np.column_stack([right, np.cross(forward, right), forward])
        pose[:3, 3] = eye
        return cls(
            width=width,
            height=height,
            fx=fx,
            fy=fx if fy is None else fy,
            cx=(width - 1) / 2 if cx is None else cx,
            cy=(height - 1) / 2 if cy is None else cy,
            cam_to_world=pose,
        )

    @property
    def position(self) -> NDArray[np.float64]:
        """(3,) m, world: the centre of projection."""
        return self.cam_to_world[:3, 3]

    @cached_property
    def matrix(self) -> NDArray[np.float64]:
        """(3, 3) camera matrix K."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @cached_property
    def table_to_pixel(self) -> NDArray[np.float64]:
        """(3, 3) homography from a point of the table plane (x, y, 1) in m to a homogeneous pixel (u, v, 1).

        Its third component is the point's depth in m: positive in front of the camera.
        """
        world_to_cam = self.cam_to_world[:3, :3].T
        translation = -world_to_cam @ self.position
        return self.matrix @ np.column_stack([world_to_cam[:, 0], world_to_cam[:, 1], translation])

    @cached_property
    def rise_per_depth(self) -> NDArray[np.float32]:
        """(H, W): world height gained per metre of depth along each pixel's ray; negative where it looks down."""
        u = (np.arange(self.width) - self.cx) / self.fx
        v = (np.arange(self.height) - self.cy) / self.fy
        row = self.cam_to_world[2, :3]
        return np.asarray(row[0] * u[None, :] + row[1] * v[:, None] + row[2], dtype=np.float32)

    def project(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """World points (N, 3) m -> pixels (N, 2) (column, row) and depth (N,) m along the optical axis.

        Points behind the camera have depth <= 0 and meaningless pixels.
        """
        local = (np.asarray(points, dtype=np.float64).reshape(-1, 3) - self.position) @ self.cam_to_world[:3, :3]
        depth = local[:, 2]
        scale = np.where(depth == 0.0, np.nan, depth)[:, None]
        return local[:, :2] / scale * (self.fx, self.fy) + (self.cx, self.cy), depth

    def back_project(self, pixels: ArrayLike, depth: ArrayLike) -> NDArray[np.float64]:
        """Pixels (N, 2) (column, row) with depth (N,) m along the optical axis -> world points (N, 3) m."""
        uv = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
        rays = np.column_stack([(uv - (self.cx, self.cy)) / (self.fx, self.fy), np.ones(len(uv))])
        local = rays * np.asarray(depth, dtype=np.float64).reshape(-1, 1)
        return local @ self.cam_to_world[:3, :3].T + self.position

    def height_above_table(self, depth: FloatArray, window: Window = WHOLE) -> NDArray[np.float32]:
        """(H, W) float32 m: world z of what each pixel sees; NaN where ``depth`` is missing (0 or not finite).

        ``depth`` is (H, W) m along the optical axis, of the whole image; ``window`` limits the work to a part of it.
        """
        if depth.shape != (self.height, self.width):
            raise PerceptionError(
                f"depth has shape {depth.shape}; this camera's images are {(self.height, self.width)}"
            )
        part = depth[window].astype(np.float32, copy=False)
        height = part * self.rise_per_depth[window] + np.float32(self.position[2])
        height[~((part > 0) & (part < np.inf))] = np.nan
        return height
