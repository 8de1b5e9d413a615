"""Measures: what the flags of an episode need of its arrays, kept in the index of a session."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.camera import CameraModel
from layflat.data.format import schema
from layflat.data.format.attributes import Attribute
from layflat.data.format.structure_checks import camera_of, mesh_shape_of

VERSION = 1
"""Raised by one whenever a measure is defined differently: the index then counts as one without measures."""
LAID_M = 0.06
"""Height below which cloth counts as laid."""
TURNED_NORMAL = -0.5
"""Largest z of a unit normal that counts as turned over: 120 degrees."""
IDLE_SHARE = 0.01
"""Largest share of the action limit with which a step counts as idle: 0.2 mm."""


@dataclass(frozen=True)
class Measures:
    """Numbers of one episode."""

    jerk: float
    """See `jerk`."""
    idle_start: int
    """Idle steps before the first motion."""
    idle_end: int
    """Idle steps after the last motion."""
    turned: float | None
    """Share of the cloth that lies turned over at the end; None without a mesh."""
    outside: float | None
    """Share of the cloth that is outside the image at the end; None without a mesh or a camera."""

    def to_json(self) -> list[float | int | None]:
        """Return the measures as a JSON list, with the version of their definition."""
        return [VERSION, *astuple(self)]

    @classmethod
    def from_json(cls, values: object) -> Measures | None:
        """Return the measures of an untrusted JSON value; None where they are missing or of another version."""
        if not isinstance(values, list) or len(values) != 6 or values[0] != VERSION:
            return None
        _, jerk, start, end, *shares = values
        if not isinstance(jerk, float | int) or not isinstance(start, int) or not isinstance(end, int):
            return None
        return cls(jerk, start, end, *shares) if all(isinstance(s, float | int | None) for s in shares) else None


def measures_of(attributes: Mapping[str, Attribute], arrays: Mapping[str, Any]) -> Measures:
    """Return the measures of a demo from ``actions`` and, where it is there, ``ground_truth/final_state``."""
    turned = outside = None
    if schema.FINAL_STATE in arrays:
        nodes = np.asarray(arrays[schema.FINAL_STATE]).reshape(-1, 3)
        camera, shape = camera_of(attributes), mesh_shape_of(attributes)
        turned = None if shape is None else turned_share(nodes.reshape(*shape, 3))
        outside = None if camera is None else outside_share(nodes, camera)
    actions = np.asarray(arrays[schema.ACTIONS])
    return Measures(jerk(actions), *idle_steps(actions), turned, outside)


def jerk(actions: FloatArray) -> float:
    """Return the sum of changes of the action (T, A) over the sum of actions; 0 of a robot that stands still."""
    path = np.linalg.norm(actions, axis=1).sum()
    return float(np.linalg.norm(np.diff(actions, axis=0), axis=1).sum() / path) if path > 0 else 0.0


def idle_steps(actions: FloatArray) -> tuple[int, int]:
    """Return the number of idle steps before the first and after the last motion; ``actions`` (T, A) in -1..1."""
    moving = np.flatnonzero((np.abs(actions) > IDLE_SHARE).any(axis=1))
    return (int(moving[0]), len(actions) - 1 - int(moving[-1])) if len(moving) else (len(actions), len(actions))


def turned_share(nodes: FloatArray) -> float:
    """Return the share of the cloth's area that lies turned over; ``nodes`` (rows, columns, 3) m, free edge first."""
    a, b, c, d = nodes[:-1, :-1], nodes[1:, :-1], nodes[:-1, 1:], nodes[1:, 1:]
    normals = np.concatenate([np.cross(c - a, b - a), np.cross(b - d, c - d)]).reshape(-1, 3)
    heights = np.concatenate([a + b + c, d + b + c])[..., 2].ravel() / 3
    areas = np.linalg.norm(normals, axis=1)
    turned = (normals[:, 2] < TURNED_NORMAL * areas) & (heights < LAID_M)
    return float(areas[turned].sum() / areas.sum()) if areas.sum() > 0 else 0.0


def outside_share(points: FloatArray, camera: CameraModel) -> float:
    """Return the share of ``points`` (N, 3) m that are not within the camera's image."""
    x, y, z = ((points - camera.cam_to_world[:3, 3]) @ camera.cam_to_world[:3, :3]).T
    depth = np.where(z > 0, z, np.inf)
    column, row = camera.fx * x / depth + camera.cx, camera.fy * y / depth + camera.cy
    seen = (z > 0) & (np.abs(column - (camera.width - 1) / 2) <= camera.width / 2)
    return float(1 - np.mean(seen & (np.abs(row - (camera.height - 1) / 2) <= camera.height / 2)))
