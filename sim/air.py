"""Still air around the cloth: what stops its swing.

Bullet's deformables have no air drag and do not expose node velocities, so a hanging cloth swings for ever. A light
plate that swings slowly loses its speed to the air at a rate of a few per second (drag coefficient about 10 at small
amplitude: 0.5 * 1.2 kg/m^3 * 0.12 m^2 * 10 * v / 0.05 kg = 2.2 /s at v = 0.15 m/s). Gravity is the one uniform force
that Bullet gives to every node, so the drag of the mean motion is a sideways gravity.
"""

from __future__ import annotations

import numpy as np

from data.types import FloatArray
from sim.cloth import Cloth
from sim.world import GRAVITY_M_S2

DRAG_RATE_PER_S = 3.0
UPDATE_S = 0.02
DRAG_LIMIT_M_S2 = 3.0
"""Drag never exceeds this, whatever a wild cloth does."""


class Air:
    """Applies the drag of the mean motion."""

    def __init__(self, cloth: Cloth, *, drag_rate_per_s: float = DRAG_RATE_PER_S) -> None:
        self._cloth = cloth
        self._rate = drag_rate_per_s
        self._every = max(1, round(UPDATE_S / cloth.world.step_s))
        self._last: tuple[int, FloatArray] | None = None

    def before_substep(self) -> None:
        """Every 20 ms: mean velocity of the cloth -> gravity of the next 20 ms."""
        world = self._cloth.world
        if world.substeps_done % self._every:
            return
        centre = self._cloth.nodes().mean(axis=0)
        last, self._last = self._last, (world.substeps_done, centre)
        if last is None:
            return
        velocity = (centre - last[1]) / ((world.substeps_done - last[0]) * world.step_s)
        drag = np.clip(-self._rate * velocity, -DRAG_LIMIT_M_S2, DRAG_LIMIT_M_S2)
        drag[2] = 0.0  # the descent is driven by the holder; only the swing needs damping
        ax, ay, az = (drag - (0.0, 0.0, GRAVITY_M_S2)).tolist()
        world.set_gravity((ax, ay, az))
