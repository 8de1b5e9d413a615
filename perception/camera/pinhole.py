"""Pinhole camera model without distortion: pose and projection.

World frame: z up, table top at z = 0, x to the robot's front, y to its left, metres.
Camera axes as in OpenCV: x right, y down, z forward. Pixel (0, 0) is the centre of the top left pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from layflat.perception.arrays import WHOLE, Float32Array, Float64Array, FloatArray, Window
from layflat.perception.errors import PerceptionError


@dataclass(frozen=True, kw_only=True, eq=False)
class PinholeCamera:
    """Ideal camera that looks at the table; the intrinsics are those of ``Intrinsics``, px."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    cam_to_world: Float64Array
    """(4, 4) rigid transform from camera axes to the world, m."""

    def __post_init__(self) -> None:
        pose = np.array(self.cam_to_world, dtype=np.float64)
        if pose.shape != (4, 4) or not np.isfinite(pose).all() or not np.allclose(pose[3], (0, 0, 0, 1)):
            raise PerceptionError(f"cam_to_world is {pose.tolist()}; it must be a (4, 4) rigid transform")
        rotation = pose[:3, :3]
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-5) or np.linalg.det(rotation) < 0:
            raise PerceptionError("cam_to_world's rotation is not orthonormal and right-handed")
        if self.width < 1 or self.height < 1 or not (self.fx > 0 and self.fy > 0):
            size = f"{self.width}x{self.height} px"
            raise PerceptionError(f"camera is {size} with fx {self.fx}, fy {self.fy}; all must be positive")
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
    ) -> PinholeCamera:
        """Return a camera at ``position`` that looks at ``target`` (world, m), with ``up`` towards the image's top.

        Pixels are square and the principal point is the image's centre.
        """
        eye = np.asarray(position, dtype=np.float64)
        forward = np.asarray(target, dtype=np.float64) - eye
        right = np.cross(forward, np.asarray(up, dtype=np.float64))
        if np.linalg.norm(right) < 1e-9 * max(1.0, float(np.linalg.norm(forward))):
            raise PerceptionError(f"up {up!r} is parallel to the view {forward.tolist()}; choose another up")
        forward /= np.linalg.norm(forward)
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3, :3] = np.column_stack([right, np.cross(forward, right), forward])
        pose[:3, 3] = eye
        cx, cy = (width - 1) / 2, (height - 1) / 2
        return cls(width=width, height=height, fx=fx, fy=fx, cx=cx, cy=cy, cam_to_world=pose)

    @property
    def position(self) -> Float64Array:
        """(3,) centre of projection, world, m."""
        return self.cam_to_world[:3, 3]

    @cached_property
    def matrix(self) -> Float64Array:
        """(3, 3) camera matrix K."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @cached_property
    def table_to_pixel(self) -> Float64Array:
        """(3, 3) homography from a point of the table plane (x, y, 1) in m to a homogeneous pixel (u, v, 1).

        Its third component is the point's depth in m: positive in front of the camera.
        """
        world_to_cam = self.cam_to_world[:3, :3].T
        translation = -world_to_cam @ self.position
        return self.matrix @ np.column_stack([world_to_cam[:, 0], world_to_cam[:, 1], translation])

    @cached_property
    def rise_per_depth(self) -> Float32Array:
        """(H, W) world height gained per metre of depth along each pixel's ray; negative where it looks down."""
        u = (np.arange(self.width) - self.cx) / self.fx
        v = (np.arange(self.height) - self.cy) / self.fy
        row = self.cam_to_world[2, :3]
        return np.asarray(row[0] * u[None, :] + row[1] * v[:, None] + row[2], dtype=np.float32)

    def project(self, points: ArrayLike) -> tuple[Float64Array, Float64Array]:
        """Project world points (N, 3) m to pixels (N, 2) (column, row) and depth (N,) m along the optical axis.

        Points behind the camera have depth <= 0 and meaningless pixels.
        """
        local = (np.asarray(points, dtype=np.float64).reshape(-1, 3) - self.position) @ self.cam_to_world[:3, :3]
        depth = local[:, 2]
        scale = np.where(depth == 0.0, np.nan, depth)[:, None]
        return local[:, :2] / scale * (self.fx, self.fy) + (self.cx, self.cy), depth

    def back_project(self, pixels: ArrayLike, depth: ArrayLike) -> Float64Array:
        """Return the world points (N, 3) m of pixels (N, 2) (column, row) at depth (N,) m along the optical axis."""
        uv = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
        rays = np.column_stack([(uv - (self.cx, self.cy)) / (self.fx, self.fy), np.ones(len(uv))])
        local = rays * np.asarray(depth, dtype=np.float64).reshape(-1, 1)
        return local @ self.cam_to_world[:3, :3].T + self.position

    def height_above_table(self, depth: FloatArray, window: Window = WHOLE) -> Float32Array:
        """Return the world z, m, of each pixel's point; NaN where ``depth`` is missing (0 or not finite).

        ``depth`` (H, W) m along the optical axis is of the whole image; ``window`` limits the work to a part of it.
        """
        if depth.shape != (self.height, self.width):
            size = (self.height, self.width)
            raise PerceptionError(f"depth has shape {depth.shape}; this camera's images are {size}")
        part = depth[window].astype(np.float32, copy=False)
        height = part * self.rise_per_depth[window] + np.float32(self.position[2])
        height[~((part > 0) & (part < np.inf))] = np.nan
        return height
