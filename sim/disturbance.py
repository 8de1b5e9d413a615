"""Forces on the cloth that nobody asked for: a stick, a hand, a gust.

Bullet ignores a force applied to a deformable, without a word. Light invisible bodies ("hands") anchored to a patch of
nodes take the force instead. In free flight momentum is then force times time: within 1 % for one node and 4 % for a
patch pushed along the cloth. A patch lifted off it loses up to 10 %, since Bullet's implicit damping does not act back
on anchored nodes; in a short jab that error (10 to 40 ms times the force) is as large as the impulse.

Like a person's stick or a mouse drag, the hands follow a path at a speed of their own with a bounded force: a bare
force for a fixed time gives erratic displacements.
"""

from __future__ import annotations

import numpy as np
import pybullet as bullet

from data.types import FloatArray
from sim.cloth import Cloth
from sim.disturbances import DisturbanceSpec, Plan
from sim.world import World

HAND_MASS_KG = 0.003
"""Nine hands of 1 g on a patch make the towel diverge, even without a force."""
HAND_STIFFNESS_1_S2 = 5000.0
"""Spring from each hand to its target, N/m per kg of hand and node. Explicit: stiffness * step^2 must stay below 1."""
HAND_DAMPING_1_S = 90.0
"""N s/m per kg of hand and node: above half of critical (141)."""
ARRIVED_M = 0.008
"""The hands let go once their target has come to its end and they are this close to it."""


class Disturbance:
    """One disturbance of one cloth; made when it begins, spent when ``done``."""

    def __init__(self, world: World, cloth: Cloth, spec: DisturbanceSpec, rng: np.random.Generator) -> None:
        """Draw place, heading and size from ``rng``; the cloth is touched at the first ``before_substep``."""
        self._world = world
        self._cloth = cloth
        self.spec = spec
        self.plan: Plan = spec.schedule(rng, cloth.spec)
        self._steps = 0
        self._settled_steps: int | None = None
        self._hands: _Hands | None = None
        self._gust: _Gust | None = None
        self._impulse = np.zeros(3)
        self._at: FloatArray | None = None

    @property
    def done(self) -> bool:
        """The force is over and the cloth has had ``settle_s`` to come to rest."""
        return self._settled_steps is not None and self._settled_steps * self._world.step_s >= self.plan.settle_s

    @property
    def acting(self) -> bool:
        """A force may still act."""
        return self._settled_steps is None

    @property
    def impulse_n_s(self) -> FloatArray:
        """(3,) N s, world: momentum that the cloth has been given so far, gravity apart."""
        if self._hands is not None:
            return self._impulse + self._hands.impulse()
        return self._impulse + (self._gust.impulse_n_s if self._gust is not None else 0.0)

    def hand_positions(self) -> FloatArray:
        """(K, 3) m, world: where hands hold the cloth now; none before, after, or in a wind."""
        return np.zeros((0, 3)) if self._hands is None else self._hands.positions()

    def before_substep(self) -> None:
        """Call before each substep, after the holder and the air have had theirs."""
        if self._settled_steps is not None:
            self._settled_steps += 1
            return
        if self._steps == 0:
            self._begin()
        time_s = self._steps * self._world.step_s
        self._steps += 1
        if self._over(time_s):
            self._finish()
        elif self._hands is not None:
            self._hands.follow(time_s)
        elif self._gust is not None:
            self._gust.blow()

    def _over(self, time_s: float) -> bool:
        if time_s >= self.plan.time_limit_s - 0.5 * self._world.step_s:
            return True
        return self._hands.arrived(time_s) if self._hands is not None else self._gust is None

    def stop(self) -> None:
        """Let go now, as when an episode is interrupted."""
        if self.acting:
            self._finish()

    def _begin(self) -> None:
        if self.plan.nodes:
            self._hands = _Hands(self._world, self._cloth, self.plan)
        elif any(self.plan.wind_m_s2):
            self._gust = _Gust(self._world, self._cloth.spec.mass_kg, np.array(self.plan.wind_m_s2))

    def _finish(self) -> None:
        self._impulse = self.impulse_n_s
        if self._hands is not None:
            self._hands.let_go()
        if self._gust is not None:
            self._gust.end()
        self._hands = self._gust = None
        self._settled_steps = 0


class _Hands:
    """Light bodies on the nodes of a patch, pulled along a common path."""

    def __init__(self, world: World, cloth: Cloth, plan: Plan) -> None:
        self._world = world
        self._cloth = cloth
        self._plan = plan
        self._start = cloth.nodes()[list(plan.nodes)]
        node_kg = cloth.spec.mass_kg / (cloth.spec.rows * cloth.spec.columns)
        # The spring is explicit, so its gains follow from the step where the step is long.
        self._stiffness = min(HAND_STIFFNESS_1_S2, 0.3 / world.step_s**2) * (HAND_MASS_KG + node_kg)
        self._damping = min(HAND_DAMPING_1_S, 0.5 / world.step_s) * (HAND_MASS_KG + node_kg)
        self._forces_n_s = np.zeros(3)
        self._bodies: list[int] = []
        self._anchors: list[int] = []
        for node, place in zip(plan.nodes, self._start, strict=True):
            body = bullet.createMultiBody(HAND_MASS_KG, basePosition=place.tolist(), physicsClientId=world.client)
            bullet.changeDynamics(body, -1, linearDamping=0.0, angularDamping=0.0, physicsClientId=world.client)
            self._bodies.append(int(body))
            self._anchors.append(cloth.anchor(node, body))

    def positions(self) -> FloatArray:
        client = self._world.client
        return np.array([bullet.getBasePositionAndOrientation(b, physicsClientId=client)[0] for b in self._bodies])

    def _velocities(self) -> FloatArray:
        client = self._world.client
        return np.array([bullet.getBaseVelocity(b, physicsClientId=client)[0] for b in self._bodies])

    def impulse(self) -> FloatArray:
        """(3,) N s: what was put in less what the hands themselves carry."""
        momentum: FloatArray = self._forces_n_s - HAND_MASS_KG * self._velocities().sum(axis=0)
        return momentum

    def arrived(self, time_s: float) -> bool:
        """Whether the targets are at the path's end and the hands near them."""
        offset, _, ended = self._plan.target(time_s)
        return ended and float(np.linalg.norm((self._start + offset - self.positions()).mean(axis=0))) < ARRIVED_M

    def follow(self, time_s: float) -> None:
        """Push all hands towards their targets for one substep."""
        offset, velocity, _ = self._plan.target(time_s)
        positions = self.positions()
        lag = self._start + offset - positions
        force = self._stiffness * lag + self._damping * (velocity - self._velocities())
        size = np.linalg.norm(force, axis=1, keepdims=True)
        force *= np.minimum(1.0, self._plan.force_limit_n / len(self._bodies) / np.maximum(size, 1e-12))
        # A hand is a tool of ours, not a load on the cloth: its weight is carried.
        carried = force - HAND_MASS_KG * np.array(self._world.gravity_m_s2)
        for body, newtons, place in zip(self._bodies, carried.tolist(), positions.tolist(), strict=True):
            bullet.applyExternalForce(body, -1, newtons, place, bullet.WORLD_FRAME, physicsClientId=self._world.client)
        self._forces_n_s += force.sum(axis=0) * self._world.step_s

    def let_go(self) -> None:
        for anchor, body in zip(self._anchors, self._bodies, strict=True):
            self._cloth.release(anchor)
            bullet.removeBody(body, physicsClientId=self._world.client)


class _Gust:
    """A sideways gravity: the one uniform force that Bullet gives to all nodes.

    Others may set the gravity too (air drag does), always without this gust, so what is found changed is the new base.
    """

    def __init__(self, world: World, mass_kg: float, wind_m_s2: FloatArray) -> None:
        self._world = world
        self._mass_kg = mass_kg
        self._wind = wind_m_s2
        self._base = self._with_gust = world.gravity_m_s2
        self.impulse_n_s = np.zeros(3)

    def blow(self) -> None:
        if self._world.gravity_m_s2 != self._with_gust:
            self._base = self._world.gravity_m_s2
        x, y, z = (np.array(self._base) + self._wind).tolist()
        self._with_gust = (x, y, z)
        self._world.set_gravity(self._with_gust)
        self.impulse_n_s = self.impulse_n_s + self._mass_kg * self._wind * self._world.step_s

    def end(self) -> None:
        if self._world.gravity_m_s2 == self._with_gust:
            self._world.set_gravity(self._base)
