"""BulletForceAnchors: light bodies on nodes of a cloth, which take the forces that Bullet does not let a cloth take.

Bullet silently ignores a force applied to a deformable. Light invisible bodies ("hands") anchored to nodes take the
force instead. In free flight momentum is then force times time: within 1 % for one node and 4 % for a patch pushed
along the cloth. A patch lifted off it loses up to 10 %, since Bullet's implicit damping does not act back on anchored
nodes; in a short jab that error (10 to 40 ms times the force) is as large as the impulse.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pybullet as bullet

from layflat.data.arrays import FloatArray
from layflat.sim.physics.base import Cloth
from layflat.sim.physics.bullet.cloth import bullet_cloth
from layflat.sim.physics.hand_springs import HAND_MASS_KG, HandSprings


class BulletForceAnchors:
    """One hand on each of some nodes, pulled to targets by springs of bounded force."""

    def __init__(self, client: int, cloth: Cloth, nodes: Sequence[int], force_limit_n: float) -> None:
        self._world = cloth.world
        self._client = client
        self._cloth = bullet_cloth(cloth)
        self.start: FloatArray = cloth.nodes()[list(nodes)]
        self._springs = HandSprings(cloth, len(nodes), force_limit_n)
        self._forces_n_s = np.zeros(3)
        self._bodies: list[int] = []
        self._anchors: list[int] = []
        for node, place in zip(nodes, self.start, strict=True):
            body = int(bullet.createMultiBody(HAND_MASS_KG, basePosition=place.tolist(), physicsClientId=client))
            bullet.changeDynamics(body, -1, linearDamping=0.0, angularDamping=0.0, physicsClientId=client)
            self._bodies.append(body)
            self._anchors.append(self._cloth.anchor(node, body))

    def positions(self) -> FloatArray:
        states = [bullet.getBasePositionAndOrientation(b, physicsClientId=self._client)[0] for b in self._bodies]
        return np.array(states)

    def _velocities(self) -> FloatArray:
        return np.array([bullet.getBaseVelocity(b, physicsClientId=self._client)[0] for b in self._bodies])

    def impulse_n_s(self) -> FloatArray:
        # The hands themselves carry a part of what was put in.
        momentum: FloatArray = self._forces_n_s - HAND_MASS_KG * self._velocities().sum(axis=0)
        return momentum

    def pull(self, targets_m: FloatArray, velocity_m_s: FloatArray) -> None:
        positions = self.positions()
        force = self._springs.force_n(targets_m - positions, velocity_m_s - self._velocities())
        # A hand is a tool, not a load on the cloth: its weight is carried.
        carried = force - HAND_MASS_KG * np.array(self._world.gravity_m_s2)
        for body, newtons, place in zip(self._bodies, carried.tolist(), positions.tolist(), strict=True):
            bullet.applyExternalForce(body, -1, newtons, place, bullet.WORLD_FRAME, physicsClientId=self._client)
        self._forces_n_s += force.sum(axis=0) * self._world.substep_s

    def release(self) -> None:
        for anchor, body in zip(self._anchors, self._bodies, strict=True):
            self._cloth.remove_anchor(anchor)
            bullet.removeBody(body, physicsClientId=self._client)
