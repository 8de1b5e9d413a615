"""MujocoForceAnchors: forces on nodes; a hand's mass is added to its node, so that it feels as in Bullet."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.sim.physics.base import Cloth
from layflat.sim.physics.hand_springs import HAND_MASS_KG, HandSprings
from layflat.sim.physics.mujoco.cloth import mujoco_cloth
from layflat.sim.physics.mujoco.engine import Engine


class MujocoForceAnchors:
    """One hand on each of some nodes, pulled to targets by springs of bounded force."""

    def __init__(self, engine: Engine, cloth: Cloth, nodes: Sequence[int], force_limit_n: float) -> None:
        self._engine, self._cloth, self._nodes = engine, mujoco_cloth(cloth), [int(node) for node in nodes]
        self._springs = HandSprings(cloth, len(self._nodes), force_limit_n)
        self._forces_n_s = np.zeros(3)
        self.start: FloatArray = self.positions()
        self._load(HAND_MASS_KG)

    def _load(self, kg: float) -> None:
        loads = self._engine.holds.loads_kg
        for node in self._nodes:
            # A drag and a disturbance may hold the same node.
            loads[node] = loads.get(node, 0.0) + kg
        self._engine.changed()

    def positions(self) -> FloatArray:
        return self._cloth.nodes()[self._nodes]

    def _velocities(self) -> FloatArray:
        return self._cloth.velocities()[self._nodes]

    def impulse_n_s(self) -> FloatArray:
        # The hands themselves carry a part of what was put in.
        momentum: FloatArray = self._forces_n_s - HAND_MASS_KG * self._velocities().sum(axis=0)
        return momentum

    def pull(self, targets_m: FloatArray, velocity_m_s: FloatArray) -> None:
        force = self._springs.force_n(targets_m - self.positions(), velocity_m_s - self._velocities())
        # A hand is a tool, not a load on the cloth: its weight is carried.
        world = self._cloth.world
        self._cloth.push(self._nodes, force - HAND_MASS_KG * np.array(world.gravity_m_s2))
        self._forces_n_s += force.sum(axis=0) * world.substep_s

    def release(self) -> None:
        self._load(-HAND_MASS_KG)
