"""ClothFrame: coordinates in which every cloth is as large as the towel, so that one policy lays them all.

On the table lengths shrink or grow with the cloth: x and y with its length and width, the height of the held edge with
what of the cloth still hangs. In the air the free edge keeps its height above the table.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.environment_spec import ClothShape
from layflat.data.robot import RobotSpec
from layflat.data.types import ACTION_LIMIT_M, Observation

NOMINAL_M = 0.35
"""Length and width of every cloth in its own frame: those of the towel, whose frame is the world's."""
REST_M = 0.004
"""Height at which cloth rests on the table, of any size."""
CENTRE_X_M = 0.18
"""Middle of where the towel is held, along x; a longer cloth starts so far behind 0 that it is laid around it."""


SIZE_KEYS = ("cloth_length_m", "cloth_width_m")
"""Settings of a recorded simulation that say how large its cloth is."""
SIZE_FACTOR = "size_factor"
"""Setting that says how much larger it was simulated."""


def home_x_m(length_m: float) -> float:
    """Return the world x over which a cloth of this length hangs before a start's moves."""
    return min(0.0, CENTRE_X_M * (1.0 - length_m / NOMINAL_M))


def recorded_settings(settings: Mapping[str, Any], shape: ClothShape | None) -> dict[str, Any]:
    """Return the settings of a simulation with the size of its cloth, before SIZE_FACTOR, where they do not say it."""
    if shape is None:
        return dict(settings)
    sides = (side / settings.get(SIZE_FACTOR, 1.0) for side in (shape.length_m, shape.width_m))
    return dict(settings) | {key: side for key, side in zip(SIZE_KEYS, sides, strict=True) if key not in settings}


@dataclass(frozen=True, kw_only=True)
class ClothFrame:
    """Coordinates of one cloth."""

    length_m: float
    width_m: float

    @property
    def is_world(self) -> bool:
        """Whether nothing is changed: the cloth is as large as the towel."""
        return self.length_m == self.width_m == NOMINAL_M

    @cached_property
    def _scale(self) -> FloatArray:
        """(3,) nominal over real length along each axis, on the table."""
        hanging = (NOMINAL_M - REST_M) / (self.length_m - REST_M)
        return np.array([NOMINAL_M / self.length_m, NOMINAL_M / self.width_m, hanging])

    def slopes(self, points_m: FloatArray) -> FloatArray:
        """Return (..., 3) by how much a short way at held points (..., 3) m of the world is longer in the frame."""
        return np.where(points_m > [np.inf, np.inf, self.length_m], 1.0, self._scale)

    def held(self, points_m: FloatArray) -> FloatArray:
        """Return held points (..., 3) m of the world in the frame."""
        origin, rest = np.array([home_x_m(self.length_m), 0.0, 0.0]), np.array([0.0, 0.0, REST_M])
        laid = (points_m - origin - rest) * self._scale + rest
        in_air = points_m + (NOMINAL_M - self.length_m)
        return np.where(points_m > [np.inf, np.inf, self.length_m], in_air, laid)

    def on_table(self, points_m: FloatArray) -> FloatArray:
        """Return points of the free edge (..., 3) m of the world in the frame: as high above the table."""
        return np.where([True, True, False], self.held(points_m), points_m)

    def observation(self, seen: Observation) -> Observation:
        """Return what a policy would see if the cloth were as large as the towel; images stay."""
        edge = None if seen.free_edge_m is None else self.on_table(seen.free_edge_m)
        corners, holder = self.held(seen.corner_positions), self.held(seen.holder_position)
        return replace(seen, corner_positions=corners, holder_position=holder, free_edge_m=edge)

    def action_to_world(self, action: FloatArray, robot: RobotSpec, seen: Observation) -> FloatArray:
        """Return an action (A,) m of the frame in the world, shortened to the limit of a step; ``seen`` there."""
        moves = action / robot.pack(self.slopes(robot.points(seen)))
        return moves * min(1.0, ACTION_LIMIT_M / max(float(np.abs(moves).max()), ACTION_LIMIT_M))
