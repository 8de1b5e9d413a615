"""MouseDrag: a hand on one node of the cloth, pulled to where the mouse is with a bounded force.

The thesis disturbs its simulated cloth by dragging it with a mouse (chapter 4-2-3).
"""

from __future__ import annotations

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.errors import SimError
from layflat.sim.physics.base import GRAVITY_M_S2, Cloth

FORCE_WEIGHTS = 1.5
"""Greatest force / weight of the cloth: enough to drag half of the cloth over the table and to lift a corner."""
SPEED_M_S = 0.5
"""Greatest speed of the target: when the mouse is flung, it arrives some steps later."""
SLIP_STRETCH = (1.38, 1.46)
"""Stretch of the cloth's edges at which the fingers slip, so that dragging does not tear it (it counts as diverged at
1.5). A napkin that hangs from its clips is stretched 1.43 times there without a drag; then they slip a little above
that, at the second value at most."""
SLIP_MORE = 0.02
FEEL_S = 0.01
"""Interval at which the fingers feel the stretch."""
PICK_RADIUS_M = 0.03
"""A ray that misses the cloth by less picks its nearest node."""


class MouseDrag:
    """One hand on one node, until `release`."""

    def __init__(self, cloth: Cloth, node: int) -> None:
        """Take hold of ``node`` where it is; of a held corner, which the robot grips, the `free_node` beside it."""
        spec = cloth.spec
        if not 0 <= node < spec.n_nodes:
            raise SimError(f"there is no node {node} to pull at; the {spec.name} has 0 to {spec.n_nodes - 1}")
        self.node = node
        self._world = world = cloth.world
        self._cloth = cloth
        self._every = world.ticks(FEEL_S)
        self._slips_at = min(max(SLIP_STRETCH[0], self._stretch() + SLIP_MORE), SLIP_STRETCH[1])
        limit_n = FORCE_WEIGHTS * cloth.spec.mass_kg * GRAVITY_M_S2
        self._hands = world.add_force_anchors(cloth, [free_node(cloth.spec, node)], limit_n)
        self._target: FloatArray = self._hands.start[0].copy()
        self._velocity = np.zeros(3)

    def start_step(self, target_m: FloatArray, step_s: float) -> None:
        """Move the target evenly towards ``target_m`` (3,) m in this step, never below where cloth rests."""
        wanted = np.array(target_m, dtype=float)
        wanted[2] = max(wanted[2], self._cloth.spec.margin_m)
        step = wanted - self._target
        step *= min(1.0, SPEED_M_S * step_s / max(float(np.linalg.norm(step)), 1e-12))
        self._velocity = step / step_s

    def before_substep(self) -> None:
        """Pull for one substep; call after ``World.begin_substep``."""
        if self._world.ticks_done % self._every == 0 and self._stretch() > self._slips_at:
            # Not to nothing at once: a hand without any force flies on with what the cloth had stored.
            self._target, self._velocity = self.position(), np.zeros(3)
        self._target = self._target + self._velocity * self._world.substep_s
        self._hands.pull(self._target[None], self._velocity)

    def _stretch(self) -> float:
        return float(self._cloth.stretch(self._cloth.nodes()).max())

    @property
    def impulse_n_s(self) -> FloatArray:
        """Momentum that the cloth has been given so far, gravity apart, (3,) N s, world."""
        return self._hands.impulse_n_s()

    def position(self) -> FloatArray:
        """Return where the hand is, (3,) m, world."""
        place: FloatArray = self._hands.positions()[0]
        return place

    def release(self) -> None:
        """Let go; the drag is over."""
        self._hands.release()


def free_node(cloth: ClothSpec, node: int) -> int:
    """Return ``node``, or beside a held corner the one that is one row and one column further in."""
    first, last = cloth.corners
    return {first: first - cloth.columns + 1, last: last - cloth.columns - 1}.get(node, node)


def pick_node(nodes: FloatArray, triangles: np.ndarray, origin: FloatArray, direction: FloatArray) -> int | None:
    """Return the node at which a ray points: the nearest corner of the first of ``triangles`` (T, 3) that it hits.

    Beside the cloth it is the node nearest to the ray, if that is within PICK_RADIUS_M, else None. Hits are found as by
    Moeller and Trumbore (1997).
    """
    size = float(np.linalg.norm(direction))
    if not (np.isfinite([*origin, *direction]).all() and size > 0):
        raise SimError(
            f"the ray from {origin} along {direction} is invalid; both must be finite, and the direction not zero"
        )
    along = np.asarray(direction, dtype=float) / size
    a, b, c = (nodes[triangles[:, k]] for k in range(3))
    u, v, away = b - a, c - a, origin - a
    across, turned = np.cross(along, v), np.cross(away, u)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1.0 / np.einsum("ij,ij->i", u, across)
        first = scale * np.einsum("ij,ij->i", away, across)
        second = scale * (turned @ along)
        reach = scale * np.einsum("ij,ij->i", v, turned)
    hit = (first >= 0) & (second >= 0) & (first + second <= 1) & (reach > 0)
    if hit.any():
        triangle = int(np.flatnonzero(hit)[np.argmin(reach[hit])])
        place = origin + reach[triangle] * along
        corners = triangles[triangle]
        return int(corners[np.argmin(np.linalg.norm(nodes[corners] - place, axis=1))])
    ahead = (nodes - origin) @ along
    aside = np.linalg.norm(nodes - origin - ahead[:, None] * along, axis=1)
    aside[ahead <= 0] = np.inf
    nearest = int(np.argmin(aside))
    return nearest if aside[nearest] <= PICK_RADIUS_M else None
