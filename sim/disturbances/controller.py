"""Forces on the cloth that nobody asked for: a stick, a hand, a gust.

Like a person's stick or a mouse drag, the hands follow a path at a speed of their own with a bounded force: a bare
force for a fixed time gives erratic displacements.
"""

from __future__ import annotations

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.cloth import Cloth
from layflat.sim.disturbances.force_anchors import ForceAnchors
from layflat.sim.disturbances.presets import DisturbanceTrajectory
from layflat.sim.physics.bullet.world import World

ARRIVED_M = 0.008
"""The hands let go once their target has come to its end and they are this close to it."""


class DisturbanceController:
    """One disturbance of one cloth; made when it begins, spent when ``done``."""

    def __init__(self, world: World, cloth: Cloth, plan: DisturbanceTrajectory) -> None:
        """Prepare the disturbance; the cloth is touched at the first ``before_substep``."""
        self._world = world
        self._cloth = cloth
        self.plan = plan
        self._began: int | None = None
        self._finished: int | None = None
        self._now = 0
        """All three as ``World.halves_done``, at a ``before_substep``."""
        self._hands: _PathAnchors | None = None
        self._gust: _Gust | None = None
        self._impulse = np.zeros(3)
        self._at: FloatArray | None = None

    @property
    def done(self) -> bool:
        """The force is over and the cloth has had ``settle_s`` to come to rest."""
        return self._finished is not None and self._world.seconds(self._now - self._finished) >= self.plan.settle_s

    @property
    def acting(self) -> bool:
        """A force may still act."""
        return self._finished is None

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
        self._now = self._world.halves_done
        if self._finished is not None:
            return
        if self._began is None:
            self._began = self._now
            self._begin()
        time_s = self._world.seconds(self._now - self._began)
        if self._over(time_s):
            self._finish()
        elif self._hands is not None:
            self._hands.follow(time_s)
        elif self._gust is not None:
            self._gust.blow()

    def _over(self, time_s: float) -> bool:
        if time_s >= self.plan.time_limit_s - 0.5 * self._world.substep_s:
            return True
        return self._hands.arrived(time_s) if self._hands is not None else self._gust is None

    def stop(self) -> None:
        """Let go now, as when an episode is interrupted."""
        if self.acting:
            self._finish()

    def _begin(self) -> None:
        if self.plan.nodes:
            self._hands = _PathAnchors(self._world, self._cloth, self.plan)
        elif any(self.plan.wind_m_s2):
            self._gust = _Gust(self._world, self._cloth.spec.mass_kg, np.array(self.plan.wind_m_s2))

    def _finish(self) -> None:
        self._impulse = self.impulse_n_s
        if self._hands is not None:
            self._hands.release()
        if self._gust is not None:
            self._gust.end()
        self._hands = self._gust = None
        self._finished = self._now


class _PathAnchors(ForceAnchors):
    """Hands on a patch that follow the path of a plan together."""

    def __init__(self, world: World, cloth: Cloth, plan: DisturbanceTrajectory) -> None:
        super().__init__(world, cloth, plan.nodes, plan.force_limit_n)
        self._plan = plan

    def arrived(self, time_s: float) -> bool:
        """Whether the targets are at the path's end and the hands near them."""
        ended = self._plan.target(time_s)[2]
        return ended and float(np.linalg.norm((self._targets(time_s) - self.positions()).mean(axis=0))) < ARRIVED_M

    def follow(self, time_s: float) -> None:
        """Push all hands towards their targets for one substep."""
        self.draw(self._targets(time_s), self._plan.target(time_s)[1])

    def _targets(self, time_s: float) -> FloatArray:
        """(K, 3) m."""
        offset = self._plan.target(time_s)[0]
        if not any(self._plan.turn_rad):
            return self.start + offset
        middle = self.start.mean(axis=0)
        turned: FloatArray = (self.start - middle) @ self._plan.turned(time_s).T
        return middle + turned + offset


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
        self.impulse_n_s = self.impulse_n_s + self._mass_kg * self._wind * self._world.substep_s

    def end(self) -> None:
        if self._world.gravity_m_s2 == self._with_gust:
            self._world.set_gravity(self._base)
