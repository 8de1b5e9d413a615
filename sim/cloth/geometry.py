"""ClothGeometry: contact, flat area, folds and stretch of a cloth, from its nodes."""

from __future__ import annotations

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.spec import ClothSpec

CONTACT_TOLERANCE_M = 0.004
"""Cloth rests on the table where it is below margin + this height: Bullet's own contact points on cloth are wrong."""
TINY_M = 1e-12
"""Replaces a zero difference of heights in a division."""
LAYERED_SHARE = 0.01
STRAINED, STRAINED_LAYERS = 1.2, 1.15
"""Stretch of an edge that only a cloth in a heap has, and one where cloth lies on cloth: a hanging or dragged cloth
stretches to 1.18, a lifted fold to 1.13."""
HEAP_GAP_M, PRESSED_GAP_M = 0.040, 0.012
"""Way of the held edge down to what lies below it, where that is a heap: with layers in it, and without a sign of them
(upright folds). A cloth that is laid with care comes within 17 mm, without layers."""
HEAP_ROWS = 3
"""Rows next to the held edge that always hang from it, and do not lie below it in a heap."""
HEAP_REACH = 1.2
"""Cells between a held node and what lies below it, along the table."""
STRETCH_LIMIT = 1.5
SPEED_LIMIT_M_S = 12.0


class ClothGeometry:
    """Measures of one cloth's nodes, (N, 3) m, world."""

    def __init__(self, spec: ClothSpec) -> None:
        self.spec = spec
        self._triangles = spec.triangles()
        flat = spec.flat_nodes()
        self._rest_area = float(_signed_areas(flat, self._triangles).sum())
        sides = [self._triangles[:, pair] for pair in ([0, 1], [1, 2], [2, 0])]
        self._edges = np.unique(np.sort(np.concatenate(sides), axis=1), axis=0)
        self._rest_lengths = np.linalg.norm(flat[self._edges[:, 0]] - flat[self._edges[:, 1]], axis=1)
        self.last_seen: tuple[float, FloatArray] | None = None
        """Time and nodes of the last call of `divergence_at`."""

    def contact_portion_true(self, nodes: FloatArray) -> float:
        """Return the share of the cloth that rests on the table, by area at rest, 0..1; blind to folds and stretch.

        Heights are linear in each triangle. The share of nodes would jump by a whole row (1/13) as a cloth is laid, and
        count a node of the border, which holds half a cell, like an inner one: 0.017 off on average, 0.12 at worst.
        """
        return float(_share_below(nodes[self._triangles, 2], self.spec.margin_m + CONTACT_TOLERANCE_M).mean())

    def flat_area(self, nodes: FloatArray) -> float:
        """Return signed projected area of the triangles on the table / cloth area; a reverse side counts negative.

        A triangle is on the table when its centroid is no higher than a second layer of cloth would lie.
        """
        heights = nodes[self._triangles, 2].mean(axis=1)
        on_table = heights < 3 * self.spec.margin_m + CONTACT_TOLERANCE_M
        return float(_signed_areas(nodes, self._triangles)[on_table].sum() / self._rest_area)

    def is_layered(self, nodes: FloatArray) -> bool:
        """Whether cloth is folded onto cloth: more than LAYERED_SHARE of the triangles are turned by 120 degrees.

        At most 0.7 % are when a cloth hangs, is laid, or is wrinkled by a stick; with a folded corner 8 to 13 %.
        """
        if not np.isfinite(nodes).all():
            return False  # Diverged; `divergence_reason` says so at the end of the step.
        a, b, c = (nodes[self._triangles[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), TINY_M)
        mean = normals.mean(axis=0)
        return bool(np.mean(normals @ mean < -0.5 * np.linalg.norm(mean)) > LAYERED_SHARE)

    def refinement(self, nodes: FloatArray) -> int:
        """Return into how many parts a step must be divided: 2 where cloth lies on cloth, 4 in a heap, 8 where it jams.

        A layer that is lifted diverges with the whole step, and a heap below the held edge with half of it, within one
        substep and without a sign before; one that lies may jam, which 8 parts undo.
        """
        layered, stretch = self.is_layered(nodes), float(self.stretch(nodes).max())
        gap = -float(self.drop_to_heap_m(nodes, nodes[list(self.spec.corners)]).max())
        if stretch > STRAINED:
            return 8
        if (layered and stretch > STRAINED_LAYERS) or gap < (HEAP_GAP_M if layered else PRESSED_GAP_M):
            return 4
        return 2 if layered else 1

    def is_jammed(self, nodes: FloatArray) -> bool:
        """Whether an edge is stretched as only layers that are caught in each other stretch it."""
        return float(self.stretch(nodes).max()) > STRAINED

    def drop_to_heap_m(self, nodes: FloatArray, points: FloatArray) -> FloatArray:
        """Return the least dz, (P,) m and at most 0, at which held points ((3,) or (P, 3) m) rest on cloth below them.

        -inf where none lies there. Clips pressed into a heap jam its layers into each other until an edge tears. Two
        points answer for half of the held edge each.
        """
        columns, margin = self.spec.columns, self.spec.margin_m
        held, rest = nodes[-columns:], nodes[: (self.spec.rows - HEAP_ROWS) * columns]
        cell = self.spec.length_m / (self.spec.rows - 1)
        away = np.hypot(*(held[:, None, k] - rest[None, :, k] for k in (0, 1)))
        below = (away < HEAP_REACH * cell) & (rest[:, 2] < held[:, 2:] + 2 * margin)
        heights = np.where(below, rest[:, 2], -np.inf).max(axis=1)
        at = np.atleast_2d(points)[:, 2]
        tops = np.array([part.max() for part in np.array_split(heights, len(at))])
        return np.minimum(tops + 2 * margin - at, 0.0)

    def stretch(self, nodes: FloatArray) -> FloatArray:
        """Return edge length / rest length, (E,)."""
        ends = nodes[self._edges]
        return np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) / self._rest_lengths

    def divergence_at(self, nodes: FloatArray, time_s: float) -> str | None:
        """Return why the cloth has diverged, or None. Call once a step: a diverging cloth is 10 to 100 times slower."""
        if not np.isfinite(nodes).all():
            return "a node is not finite"
        stretch = float(self.stretch(nodes).max())
        if stretch > STRETCH_LIMIT:
            return f"an edge is stretched {stretch:.2f} times"
        last, self.last_seen = self.last_seen, (time_s, nodes)
        if last is not None and time_s > last[0]:
            speed = float(np.linalg.norm(nodes - last[1], axis=1).max() / (time_s - last[0]))
            if speed > SPEED_LIMIT_M_S:
                return f"a node moves at {speed:.1f} m/s"
        return None


def _signed_areas(nodes: FloatArray, triangles: np.ndarray) -> FloatArray:
    a, b, c = (nodes[triangles[:, k], :2] for k in range(3))
    u, v = b - a, c - a
    return 0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])


def _share_below(heights: FloatArray, level: float) -> FloatArray:
    """Return the share of each triangle's area below ``level``, (T,); ``heights`` (T, 3) of its corners."""
    # Below the middle corner it is the triangle cut off at the lowest one, above it all but that at the highest.
    low, middle, high = np.sort(heights, axis=1).T
    span = np.maximum(high - low, TINY_M)
    below = np.maximum(level - low, 0.0) ** 2 / (span * np.maximum(middle - low, TINY_M))
    above = 1.0 - np.maximum(high - level, 0.0) ** 2 / (span * np.maximum(high - middle, TINY_M))
    share: FloatArray = np.clip(np.where(level <= middle, below, above), 0.0, 1.0)
    return share
