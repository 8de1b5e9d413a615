"""HandSprings: the law by which a hand pulls its node, the same in every engine."""

from __future__ import annotations

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.sim.physics.base import Cloth

HAND_MASS_KG = 0.003
"""Nine hands of 1 g on a patch make Bullet's towel diverge, even without a force."""
HAND_STIFFNESS_1_S2 = 5000.0
"""Spring from each hand to its target, N/m per kg of hand and node. Explicit: stiffness * step^2 must stay below 1."""
HAND_DAMPING_1_S = 90.0
"""N s/m per kg of hand and node: above half of critical (141)."""


class HandSprings:
    """Springs and dampers of some hands on a cloth."""

    def __init__(self, cloth: Cloth, hands: int, force_limit_n: float) -> None:
        kg = HAND_MASS_KG + cloth.spec.mass_kg / cloth.spec.n_nodes
        # The spring is explicit, so its gains follow from the step where the step is long.
        self._stiffness = min(HAND_STIFFNESS_1_S2, 0.3 / cloth.world.coarse_substep_s**2) * kg
        self._damping = min(HAND_DAMPING_1_S, 0.5 / cloth.world.coarse_substep_s) * kg
        self._limit_n = force_limit_n / hands

    def force_n(self, lag_m: FloatArray, slip_m_s: FloatArray) -> FloatArray:
        """Return the force on each hand, (K, 3) N, that is ``lag_m`` behind its target and ``slip_m_s`` slower."""
        force: FloatArray = self._stiffness * lag_m + self._damping * slip_m_s
        size = np.linalg.norm(force, axis=1, keepdims=True)
        force *= np.minimum(1.0, self._limit_n / np.maximum(size, 1e-12))
        return force
