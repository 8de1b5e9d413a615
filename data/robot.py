"""Robots as data, policies and teleoperators know them: by the axes along which they are moved."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from layflat.data.arrays import FloatArray
from layflat.data.errors import DataError

_NAME = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")
_AXIS_NAME = re.compile(r"d[a-z][a-z0-9_]*")
MAX_POINTS = 2


class Positions(Protocol):
    """The positions of an observation that a robot is described by."""

    @property
    def holder_position(self) -> FloatArray:
        """(3,) m, world."""

    @property
    def corner_positions(self) -> FloatArray:
        """(2, 3) m, world."""


@dataclass(frozen=True, kw_only=True)
class ActionAxis:
    """One number of an action: how far one point of the robot moves along one axis of the world in a step."""

    name: str
    """``d`` and the name of the coordinate: ``dx``, ``dz2``."""
    point: int
    """Row of `RobotSpec.points`."""
    axis: int
    """0, 1 or 2 for x, y or z of the world frame."""

    def __post_init__(self) -> None:
        if not _AXIS_NAME.fullmatch(self.name):
            raise DataError(f"action axis is named {self.name!r}; it must be d and a coordinate, as in dx or dz2")
        if self.point not in range(MAX_POINTS) or self.axis not in range(3):
            raise DataError(
                f"action axis {self.name} moves point {self.point} along axis {self.axis}; must be 0..1, 0..2"
            )

    @property
    def coordinate(self) -> str:
        """Name of the coordinate that the axis moves: ``x``, ``z2``."""
        return self.name[1:]


@dataclass(frozen=True, kw_only=True)
class RobotSpec:
    """The name of a robot and the axes of its actions.

    A robot with one point is moved as a whole, at its holder's centre; one with two points moves each of the two held
    corners, point 0 at +y and point 1 at -y.
    """

    name: str
    axes: tuple[ActionAxis, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "axes", tuple(self.axes))
        if not _NAME.fullmatch(self.name):
            raise DataError(f"robot is named {self.name!r}; use small letters, digits and single hyphens")
        moved = [(axis.point, axis.axis) for axis in self.axes]
        if not moved or len(set(moved)) != len(moved) or len(set(self.action_names)) != len(moved):
            raise DataError(f"robot {self.name} has axes {self.action_names}; it needs at least one, and none twice")

    def __str__(self) -> str:
        return self.name

    @property
    def size(self) -> int:
        """Number of components of an action, A."""
        return len(self.axes)

    @property
    def action_names(self) -> tuple[str, ...]:
        """Names of the components of an action."""
        return tuple(axis.name for axis in self.axes)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates that the action displaces, in its order."""
        return tuple(axis.coordinate for axis in self.axes)

    @property
    def n_points(self) -> int:
        """Number of points that move on their own: 1 or 2."""
        return 1 + max(axis.point for axis in self.axes)

    @property
    def hand_shape(self) -> tuple[int, ...]:
        """Shape of the place of a guiding hand: (3,) for one point, (2, 3) for two."""
        return (3,) if self.n_points == 1 else (self.n_points, 3)

    def same_axes(self, other: RobotSpec) -> bool:
        """Whether a policy that moves ``other`` can move this robot: the same points along the same axes."""
        return self.axes == other.axes

    def zeros(self) -> FloatArray:
        """Return the action that moves nothing, (A,)."""
        return np.zeros(self.size)

    def pack(self, displacements_m: ArrayLike) -> FloatArray:
        """Return the action (A,) that moves each point by its row of (P, 3), or all of them by (3,); m, world."""
        rows = np.broadcast_to(np.asarray(displacements_m, dtype=np.float64), (self.n_points, 3))
        return np.array([rows[axis.point, axis.axis] for axis in self.axes])

    def unpack(self, action: ArrayLike) -> FloatArray:
        """Return the displacement of each point, (P, 3) m, world; 0 along axes that the robot does not have."""
        rows = np.zeros((self.n_points, 3))
        for axis, value in zip(self.axes, np.asarray(action, dtype=np.float64), strict=True):
            rows[axis.point, axis.axis] = value
        return rows

    def points(self, observation: Positions) -> FloatArray:
        """Return where the points are, (P, 3) m, world."""
        return observation.holder_position[np.newaxis] if self.n_points == 1 else observation.corner_positions

    def position(self, observation: Positions) -> FloatArray:
        """Return the coordinates that an action displaces, (A,) m, world."""
        return self.pack(self.points(observation))

    def axes_json(self) -> str:
        """Return the axes as JSON, for files."""
        return json.dumps([[axis.name, axis.point, axis.axis] for axis in self.axes])

    @classmethod
    def from_json(cls, name: str, axes: str) -> RobotSpec:
        """Make a robot of its name and what `axes_json` returned; DataError where that is damaged."""
        try:
            rows: Any = json.loads(axes)
            return cls(name=name, axes=tuple(_axis(row) for row in rows))
        except (json.JSONDecodeError, RecursionError, TypeError):
            raise DataError(f"action axes are {axes[:80]!r}; they must be a list of [name, point, axis]") from None


def _axis(row: Any) -> ActionAxis:
    name, point, axis = row if isinstance(row, list) and len(row) == 3 else (None, None, None)
    if type(name) is not str or type(point) is not int or type(axis) is not int:
        raise TypeError
    return ActionAxis(name=name, point=point, axis=axis)


def one_point(name: str, **axes: int) -> RobotSpec:
    """Make a robot that moves as a whole, of ``dx=0, dz=2``."""
    return RobotSpec(name=name, axes=tuple(ActionAxis(name=key, point=0, axis=axis) for key, axis in axes.items()))


def two_points(name: str) -> RobotSpec:
    """Make a robot that moves each of the two held corners along x, y and z."""
    axes = (
        ActionAxis(name=f"d{'xyz'[axis]}{point + 1}", point=point, axis=axis) for point in (0, 1) for axis in (0, 1, 2)
    )
    return RobotSpec(name=name, axes=tuple(axes))
