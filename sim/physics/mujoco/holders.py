"""MujocoHolders: bodies that are where they are put, each joined to a node, which follows within 0.4 mm."""

from __future__ import annotations

from collections.abc import Sequence

from layflat.data.arrays import FloatArray
from layflat.sim.physics.base import Cloth
from layflat.sim.physics.mujoco.engine import Engine


class MujocoHolders:
    """Kinematic points."""

    def __init__(self, engine: Engine, positions_m: FloatArray) -> None:
        self._engine = engine
        first = max(engine.holds.points, default=-1) + 1
        self._keys = list(range(first, first + len(positions_m)))
        engine.holds.points |= dict(zip(self._keys, positions_m.tolist(), strict=True))
        engine.changed()

    def grasp(self, cloth: Cloth, nodes: Sequence[int]) -> None:
        self._engine.holds.point_nodes |= dict(zip(self._keys, map(int, nodes), strict=True))
        self._engine.changed()

    def move(self, positions_m: Sequence[list[float]], velocities_m_s: Sequence[list[float]]) -> None:
        self._engine.holds.points.update(zip(self._keys, positions_m, strict=True))

    def stop(self) -> None:
        pass

    def release(self) -> None:
        for key in self._keys:
            self._engine.holds.points.pop(key)
            self._engine.holds.point_nodes.pop(key, None)
        self._keys = []
        self._engine.changed()
