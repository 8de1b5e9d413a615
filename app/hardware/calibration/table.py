"""The table's plane: tilt and height of the camera over it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from layflat.data.arrays import FloatArray
from layflat.perception.camera.intrinsics import Intrinsics
from layflat.perception.camera.table_plane import fit_table_plane

FRAMES = 15


@dataclass(frozen=True, kw_only=True)
class TableCalibration:
    """The camera's pose with the table's plane at z = 0."""

    cam_to_world: FloatArray
    """(4, 4)."""
    turned_deg: float
    """How far the pose had to be turned."""
    raised_m: float
    """How far it had to be raised."""
    rms_m: float
    """Scatter of the depth about the plane."""
    inlier_share: float


def calibrate_table(
    depths: Sequence[NDArray[np.float32]], intrinsics: Intrinsics, cam_to_world: FloatArray
) -> TableCalibration:
    """Fit the plane (RANSAC) to the median of ``depths`` (H, W) m, and correct tilt and height of the pose.

    Where x and y point and where their origin is, a plane does not tell; that stays. PerceptionError without a table.
    """
    stack = np.stack(depths).astype(np.float64)
    stack[stack <= 0] = np.nan
    with np.errstate(all="ignore"):
        depth = np.nan_to_num(np.nanmedian(stack, axis=0)) if np.isfinite(stack).any() else np.zeros(stack.shape[1:])
    plane = fit_table_plane(depth.astype(np.float32), intrinsics, rng=np.random.default_rng(0))
    pose = np.array(cam_to_world)
    normal = pose[:3, :3] @ plane.normal
    # The smallest turn that makes the plane level.
    axis, up = np.cross(normal, (0.0, 0.0, 1.0)), np.array([0.0, 0.0, 1.0])
    angle = float(np.arctan2(np.linalg.norm(axis), normal @ up))
    size = float(np.linalg.norm(axis))
    turn = Rotation.from_rotvec(axis / size * angle if size > 1e-12 else np.zeros(3))
    pose[:3, :3] = turn.as_matrix() @ pose[:3, :3]
    raised = plane.distance_m - pose[2, 3]
    pose[2, 3] = plane.distance_m
    return TableCalibration(
        cam_to_world=pose,
        turned_deg=float(np.rad2deg(angle)),
        raised_m=float(raised),
        rms_m=plane.rms_m,
        inlier_share=plane.inlier_share,
    )
