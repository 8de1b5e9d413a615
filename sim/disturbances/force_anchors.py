"""Light bodies on nodes of a cloth, which take the forces that Bullet does not let a cloth take itself.

Bullet ignores a force applied to a deformable, without a word. Light invisible bodies ("hands") anchored to nodes take
the force instead. In free flight momentum is then force times time: within 1 % for one node and 4 % for a patch pushed
along the cloth. A patch lifted off it loses up to 10 %, since Bullet's implicit damping does not act back on anchored
nodes; in a short jab that error (10 to 40 ms times the force) is as large as the impulse.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pybullet as bullet

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.cloth import Cloth
from layflat.sim.physics.bullet.world import World

HAND_MASS_KG = 0.003
"""Nine hands of 1 g on a patch make the towel diverge, even without a force."""
HAND_STIFFNESS_1_S2 = 5000.0
"""Spring from each hand to its target, N/m per kg of hand and node. Explicit: stiffness * step^2 must stay below 1."""
HAND_DAMPING_1_S = 90.0
"""N s/m per kg of hand and node: above half of critical (141)."""


class ForceAnchors:
    """One hand on each of some nodes, drawn to targets by springs of bounded force."""

    def __init__(self, world: World, cloth: Cloth, nodes: Sequence[int], force_limit_n: float) -> None:
        """Take hold of ``nodes`` where they are now; ``force_limit_n`` is that of all hands together."""
        self._world = world
        self._cloth = cloth
        self.force_limit_n = force_limit_n
        self.start: FloatArray = cloth.nodes()[list(nodes)]
        """(K, 3) m: where the hands took hold."""
        node_kg = cloth.spec.mass_kg / (cloth.spec.rows * cloth.spec.columns)
        # The spring is explicit, so its gains follow from the step where the step is long.
        self._stiffness = min(HAND_STIFFNESS_1_S2, 0.3 / world.coarse_substep_s**2) * (HAND_MASS_KG + node_kg)
        self._damping = min(HAND_DAMPING_1_S, 0.5 / world.coarse_substep_s) * (HAND_MASS_KG + node_kg)
        self._forces_n_s = np.zeros(3)
        self._bodies: list[int] = []
        self._anchors: list[int] = []
        for node, place in zip(nodes, self.start, strict=True):
            body = bullet.createMultiBody(HAND_MASS_KG, basePosition=place.tolist(), physicsClientId=world.client)
            bullet.changeDynamics(body, -1, linearDamping=0.0, angularDamping=0.0, physicsClientId=world.client)
            self._bodies.append(int(body))
            self._anchors.append(cloth.anchor(node, body))

    def positions(self) -> FloatArray:
        """(K, 3) m, world."""
        client = self._world.client
        return np.array([bullet.getBasePositionAndOrientation(b, physicsClientId=client)[0] for b in self._bodies])

    def _velocities(self) -> FloatArray:
        client = self._world.client
        return np.array([bullet.getBaseVelocity(b, physicsClientId=client)[0] for b in self._bodies])

    def impulse(self) -> FloatArray:
        """(3,) N s: what was put in less what the hands themselves carry."""
        momentum: FloatArray = self._forces_n_s - HAND_MASS_KG * self._velocities().sum(axis=0)
        return momentum

    def draw(self, targets: FloatArray, velocity: FloatArray) -> None:
        """Push each hand towards its target (K, 3) m, which moves at ``velocity`` (3,) m/s, for one substep."""
        positions = self.positions()
        lag = targets - positions
        force = self._stiffness * lag + self._damping * (velocity - self._velocities())
        size = np.linalg.norm(force, axis=1, keepdims=True)
        force *= np.minimum(1.0, self.force_limit_n / len(self._bodies) / np.maximum(size, 1e-12))
        # A hand is a tool of ours, not a load on the cloth: its weight is carried.
        carried = force - HAND_MASS_KG * np.array(self._world.gravity_m_s2)
        for body, newtons, place in zip(self._bodies, carried.tolist(), positions.tolist(), strict=True):
            bullet.applyExternalForce(body, -1, newtons, place, bullet.WORLD_FRAME, physicsClientId=self._world.client)
        self._forces_n_s += force.sum(axis=0) * self._world.substep_s

    def release(self) -> None:
        """Take the hands away; use them no more."""
        for anchor, body in zip(self._anchors, self._bodies, strict=True):
            self._cloth.release(anchor)
            bullet.removeBody(body, physicsClientId=self._world.client)
