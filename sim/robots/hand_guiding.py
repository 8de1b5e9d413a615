"""Kinesthetic teaching (chapter 4-3-2): a hand leads the hanger of an arm that yields along x and z.

Of the arm's law only y and the rotations keep their springs; along x and z there are damping, the arm's own weight
carried, the weight of the cloth in the clips carried, and the friction of a real arm's joints, without which the
smallest error of that weight would let it creep away.
"""

from __future__ import annotations

import numpy as np

from layflat.data.arrays import FloatArray

HAND_STIFFNESS_N_M = 300.0
"""A person's arm that holds on."""
HAND_DAMPING_N_S_M = 40.0
"""Of the hand's grip, against the hanger's speed relative to the hand's."""
HAND_LIMIT_N = 10.0
"""A hand that gets further ahead than 33 mm pulls no harder."""
HAND_SPEED_M_S = 0.15
"""Of the hand at most: 15 mm a step, which an action can hold."""
FRICTION_N = 0.5
"""The arm stays where it is under a smaller force."""
FRICTION_STIFFNESS_N_M = 400.0
"""How stiffly friction holds it there: 1.25 mm."""
WALL_STIFFNESS_N_M = 1500.0
"""Of the workspace's borders, the table's height among them, to a hanger that is pushed or coasts beyond them."""
_IN_PLANE = np.array([1.0, 0.0, 1.0])


class HandGuiding:
    """One hand on the hanger, from the first guided step until the arm holds itself again."""

    def __init__(self, place: FloatArray, held_n: FloatArray, load_n: float, substep_s: float) -> None:
        """``place`` (3,) m: corners' midpoint now; ``held_n`` (3,) N: force of the springs that let go now.

        ``load_n`` (upwards) of it is the cloth's weight. Friction takes over the rest, so that nothing moves yet.
        """
        self.substep_s = substep_s
        """Of the substeps to come."""
        self._hand: FloatArray | None = None
        self._velocity = np.zeros(3)
        self._last = place
        self._load = np.array([0.0, 0.0, load_n])
        friction = _bounded((held_n - self._load) * _IN_PLANE, FRICTION_N)
        self._stuck_at: FloatArray = place + friction / FRICTION_STIFFNESS_N_M
        self._pushes: list[FloatArray] = []

    def start_step(self, place: FloatArray, hand_m: FloatArray | None, substeps: int, load_n: float) -> None:
        """Lead the hand evenly towards ``hand_m`` (3,) m in this step, or take it away."""
        self._load = np.array([0.0, 0.0, load_n])
        self._pushes = []
        self._last = place
        if hand_m is None:
            self._hand = None
            return
        self._hand = place.copy() if self._hand is None else self._hand
        duration_s = substeps * self.substep_s
        self._velocity = _bounded((hand_m - self._hand) * _IN_PLANE / duration_s, HAND_SPEED_M_S)

    def hand_push_n(self, place: FloatArray) -> FloatArray:
        """(3,) N on the hanger at ``place`` (3,) m in this substep; call it once in each."""
        moved, self._last = place - self._last, place
        if self._hand is None:
            push = np.zeros(3)
        else:
            self._hand = self._hand + self._velocity * self.substep_s
            lead, slip = self._hand - place, self._velocity - moved / self.substep_s
            push = _bounded((HAND_STIFFNESS_N_M * lead + HAND_DAMPING_N_S_M * slip) * _IN_PLANE, HAND_LIMIT_N)
        self._pushes.append(push)
        return push

    def hand_force_n(self) -> FloatArray:
        """(3,) N: mean push of this step."""
        return np.mean(self._pushes, axis=0) if self._pushes else np.zeros(3)

    def carried_n(self, place: FloatArray) -> FloatArray:
        """(3,) N that the arm exerts on what it carries: load and friction; friction gives way as ``place`` moves."""
        friction = _bounded((self._stuck_at - place) * FRICTION_STIFFNESS_N_M * _IN_PLANE, FRICTION_N)
        self._stuck_at = place + friction / FRICTION_STIFFNESS_N_M
        return self._load + friction


def _bounded(vector: FloatArray, limit: float) -> FloatArray:
    """``vector`` (3,), no longer than ``limit``."""
    return vector * min(1.0, limit / max(float(np.linalg.norm(vector)), 1e-12))
