"""DisturbanceController: forces on the cloth from outside, such as a stick, a hand or a gust.

Like a person's stick or a mouse drag, the hands follow a path at a speed of their own with a bounded force: a bare
force for a fixed time gives erratic displacements.
"""

from __future__ import annotations

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.sim.disturbances.presets import DisturbanceTrajectory
from layflat.sim.physics.base import Cloth, ForceAnchors

ARRIVED_M = 0.008
"""The hands let go once their target has come to its end and they are this close to it."""


class DisturbanceController:
    """One disturbance of one cloth, until it is `done`; the cloth is touched at the first `before_substep`."""

    def __init__(self, cloth: Cloth, plan: DisturbanceTrajectory) -> None:
        self._world = cloth.world
        self._cloth = cloth
        self.plan = plan
        self._began: int | None = None
        self._finished: int | None = None
        self._now = 0
        """These three are values of ``World.ticks_done`` at a `before_substep`."""
        self._hands: ForceAnchors | None = None
        self._blowing = False
        self._impulse = np.zeros(3)

    @property
    def done(self) -> bool:
        """Whether the force is over and the cloth has had ``settle_s`` to come to rest."""
        return self._finished is not None and self._world.seconds(self._now - self._finished) >= self.plan.settle_s

    @property
    def impulse_n_s(self) -> FloatArray:
        """Momentum that the cloth has been given so far, gravity apart, (3,) N s, world."""
        return self._impulse if self._hands is None else self._impulse + self._hands.impulse_n_s()

    def hand_positions(self) -> FloatArray:
        """Return where hands hold the cloth now, (K, 3) m, world; none before, after, or in a wind."""
        return np.zeros((0, 3)) if self._hands is None else self._hands.positions()

    def before_substep(self) -> None:
        """Apply the forces of the next substep; call after ``World.begin_substep``."""
        self._now = self._world.ticks_done
        if self._finished is not None:
            return
        if self._began is None:
            self._began = self._now
            if self.plan.nodes:
                self._hands = self._world.add_force_anchors(self._cloth, self.plan.nodes, self.plan.force_limit_n)
        time_s = self._world.seconds(self._now - self._began)
        if self._is_over(time_s):
            self.stop()
        elif self._hands is not None:
            self._hands.pull(self._targets(self._hands, time_s), self.plan.target(time_s)[1])
        else:
            self._blow()

    def stop(self) -> None:
        """Let go now, also when a disturbance is interrupted."""
        if self._finished is not None:
            return
        self._impulse = self.impulse_n_s
        if self._hands is not None:
            self._hands.release()
            self._hands = None
        if self._blowing:
            self._world.set_wind(None)
        self._finished = self._now

    def _is_over(self, time_s: float) -> bool:
        if time_s >= self.plan.time_limit_s - 0.5 * self._world.substep_s or not self.plan.acts:
            return True
        if self._hands is None or not self.plan.target(time_s)[2]:
            return False
        missing = self._targets(self._hands, time_s) - self._hands.positions()
        return float(np.linalg.norm(missing.mean(axis=0))) < ARRIVED_M

    def _targets(self, hands: ForceAnchors, time_s: float) -> FloatArray:
        """Return the targets of all hands, (K, 3) m."""
        offset = self.plan.target(time_s)[0]
        if not any(self.plan.turn_rad):
            return hands.start + offset
        middle = hands.start.mean(axis=0)
        turned: FloatArray = (hands.start - middle) @ self.plan.turned(time_s).T
        return middle + turned + offset

    def _blow(self) -> None:
        if not self._blowing:
            self._world.set_wind(self.plan.wind_m_s2)
            self._blowing = True
        wind = np.array(self.plan.wind_m_s2)
        self._impulse = self._impulse + self._cloth.spec.mass_kg * wind * self._world.substep_s
