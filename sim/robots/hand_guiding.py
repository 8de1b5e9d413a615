"""HandGuiding: kinesthetic teaching (chapter 4-3-2) of an arm that yields along x and z.

Only y and the rotations keep the springs of the arm's law. Along x and z the arm is damped, carries its own weight and
that of the cloth in the clips, and has the friction of a real arm's joints, without which the smallest error of that
weight would let it creep away.
"""

from __future__ import annotations

import numpy as np

from layflat.data.arrays import FloatArray

HAND_STIFFNESS_N_M = 300.0
"""Stiffness of a person's arm."""
HAND_DAMPING_N_S_M = 40.0
"""Damping of the hand's grip, by the hanger's speed relative to the hand."""
HAND_LIMIT_N = 10.0
"""Greatest force, which a hand that is 33 mm ahead reaches."""
HAND_SPEED_M_S = 0.15
"""Greatest speed of the hand: 15 mm a step, which an action can hold."""
FRICTION_N = 0.5
"""The arm stays where it is under a smaller force."""
FRICTION_STIFFNESS_N_M = 400.0
"""Stiffness with which friction holds it there, within 1.25 mm."""
WALL_STIFFNESS_N_M = 1500.0
"""Stiffness of the workspace's borders, such as the table, to a hanger that is pushed or coasts beyond them."""
_IN_PLANE = np.array([1.0, 0.0, 1.0])


class HandGuiding:
    """One hand on the hanger, until the arm is no longer guided."""

    def __init__(self, place: FloatArray, held_n: FloatArray, load_n: float, substep_s: float) -> None:
        """Start at ``place`` (3,) m; of the springs' force ``held_n`` (3,) N friction takes what is not ``load_n``."""
        self.substep_s = substep_s
        """Duration of the coming substeps."""
        self._hand: FloatArray | None = None
        self._velocity = np.zeros(3)
        self._last = place
        self._load = np.array([0.0, 0.0, load_n])
        friction = _bounded((held_n - self._load) * _IN_PLANE, FRICTION_N)
        self._stuck_at: FloatArray = place + friction / FRICTION_STIFFNESS_N_M

    def start_step(self, place: FloatArray, hand_m: FloatArray | None, substeps: int, load_n: float) -> None:
        """Move the hand evenly towards ``hand_m`` (3,) m in this step, or take it away."""
        self._load = np.array([0.0, 0.0, load_n])
        self._last = place
        if hand_m is None:
            self._hand = None
            return
        self._hand = place.copy() if self._hand is None else self._hand
        duration_s = substeps * self.substep_s
        self._velocity = _bounded((hand_m - self._hand) * _IN_PLANE / duration_s, HAND_SPEED_M_S)

    def hand_push_n(self, place: FloatArray) -> FloatArray:
        """Return the push on the hanger at ``place`` (3,) m in this substep, (3,) N; call it once in each."""
        moved, self._last = place - self._last, place
        if self._hand is None:
            return np.zeros(3)
        self._hand = self._hand + self._velocity * self.substep_s
        lead, slip = self._hand - place, self._velocity - moved / self.substep_s
        return _bounded((HAND_STIFFNESS_N_M * lead + HAND_DAMPING_N_S_M * slip) * _IN_PLANE, HAND_LIMIT_N)

    def carried_n(self, place: FloatArray) -> FloatArray:
        """Return load and friction that the arm exerts at ``place``, (3,) N; friction gives way as ``place`` moves."""
        friction = _bounded((self._stuck_at - place) * FRICTION_STIFFNESS_N_M * _IN_PLANE, FRICTION_N)
        self._stuck_at = place + friction / FRICTION_STIFFNESS_N_M
        return self._load + friction


def _bounded(vector: FloatArray, limit: float) -> FloatArray:
    """Return ``vector`` (3,), shortened to ``limit`` where it is longer."""
    return vector * min(1.0, limit / max(float(np.linalg.norm(vector)), 1e-12))
