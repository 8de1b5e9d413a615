"""AirDrag: still air around the cloth, which stops its swing.

Neither engine's cloth feels the air, so a hanging one swings for ever, and Bullet hides the nodes' velocities. A light
plate that swings slowly loses its speed to the air at a rate of a few per second (drag coefficient about 10 at small
amplitude: 0.5 * 1.2 kg/m^3 * 0.12 m^2 * 10 * v / 0.05 kg = 2.2 /s at v = 0.15 m/s). Gravity is the one uniform force
that Bullet gives to every node, so the drag of the mean motion is a sideways gravity, in every engine alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from layflat.sim.physics.base import GRAVITY_M_S2, Cloth, Vector

DRAG_RATE_PER_S = 3.0
UPDATE_S = 0.02
DRAG_LIMIT_M_S2 = 3.0
"""Bound of the drag, however fast a diverging cloth moves."""


class AirDrag:
    """Drag of the cloth's mean motion."""

    def __init__(self, cloth: Cloth, set_gravity: Callable[[Vector], None]) -> None:
        self._world = world = cloth.world
        self._set_gravity = set_gravity
        self._cloth = cloth
        self._every = world.ticks(UPDATE_S)
        self._last: tuple[int, float, float] | None = None
        """``ticks_done``, and the cloth's centre along x and y, m."""

    def update(self) -> None:
        """Set the gravity of the next 20 ms by the cloth's mean velocity; acts every 20 ms."""
        world = self._world
        if world.ticks_done % self._every:
            return
        # Single numbers from here on: numpy's overhead on three of them is most of what this would cost.
        cx, cy, _ = self._cloth.nodes().mean(axis=0).tolist()
        if not math.isfinite(cx + cy):
            return  # The simulation finds a cloth that has diverged at the end of the step.
        last, self._last = self._last, (world.ticks_done, cx, cy)
        if last is None:
            return
        duration_s = world.seconds(world.ticks_done - last[0])
        # The descent is driven by the robot; only the swing needs damping.
        ax, ay = _drag((cx - last[1]) / duration_s), _drag((cy - last[2]) / duration_s)
        self._set_gravity((ax, ay, -GRAVITY_M_S2))


def _drag(velocity_m_s: float) -> float:
    return min(max(-DRAG_RATE_PER_S * velocity_m_s, -DRAG_LIMIT_M_S2), DRAG_LIMIT_M_S2)
