"""The soft body: presets, mesh, nodes, anchors, true contact, flat area, stability guard.

A cloth is a row-major grid: row 0 is the free edge, the last row is held; column 0 lies at +y. Laid flat, row i
lies at x = i / (rows - 1) * length, its face up. Two-triangle cells with alternating diagonals.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
import pybullet as bullet

from layflat.data.arrays import FloatArray
from layflat.sim.errors import SimError
from layflat.sim.physics.bullet.world import World

CONTACT_TOLERANCE_M = 0.004
"""Cloth rests on the table where it is below margin + this height (chapter 4-3-2 asks for contact, Bullet's own
contact points on cloth are wrong)."""
TINY_M = 1e-12
"""Stands for a difference of heights that is zero, where it divides."""
LAYERED_SHARE = 0.01
STRETCH_LIMIT = 1.5
SPEED_LIMIT_M_S = 12.0
HELD_STRETCH = 1.03
"""Distance of the two holders / width of the cloth: a hanger holds the hem taut, so that it does not flop to a side."""


@dataclass(frozen=True, kw_only=True)
class ClothSpec:
    """What a cloth is made of. Stiffness and damping are per spring, so they belong to one node count."""

    name: str
    length_m: float
    """Along x when flat, free edge to held edge."""
    width_m: float
    """Along y, between the two held corners."""
    rows: int
    columns: int
    mass_kg: float
    elastic_n_m: float
    damping_n_s_m: float
    """Springs are explicit and damping is implicit: keep it above elastic * step / 2."""
    bending_n_m: float
    friction: float = 0.5
    margin_m: float = 0.004
    """Half the distance that Bullet keeps between cloth and cloth; the cloth rests at this height."""
    rate_hz: float = 240.0
    """Physics steps a second."""

    def __post_init__(self) -> None:
        for field in ("length_m", "width_m", "mass_kg", "elastic_n_m", "rate_hz", "margin_m"):
            if not getattr(self, field) > 0:
                raise SimError(f"cloth {self.name}: {field} is {getattr(self, field)}; it must be above 0")
        if self.rows < 2 or self.columns < 2:
            raise SimError(f"cloth {self.name}: {self.rows} x {self.columns} nodes; at least 2 x 2 are needed")
        if self.damping_n_s_m <= self.elastic_n_m / self.rate_hz / 2:
            raise SimError(
                f"cloth {self.name}: damping {self.damping_n_s_m} is at most elastic * step / 2: it explodes"
            )

    @property
    def area_m2(self) -> float:
        return self.length_m * self.width_m

    @property
    def corners(self) -> tuple[int, int]:
        """Held nodes: picker 1 (+y), picker 2 (-y)."""
        return (self.rows - 1) * self.columns, self.rows * self.columns - 1

    def triangles(self) -> np.ndarray:
        """(T, 3) node indices, counter-clockwise seen from above when flat with the face up."""
        faces = []
        for i in range(self.rows - 1):
            for j in range(self.columns - 1):
                a, b = i * self.columns + j, i * self.columns + j + 1
                c, d = a + self.columns, b + self.columns
                faces += [(a, b, c), (b, d, c)] if (i + j) % 2 else [(a, d, c), (a, b, d)]
        return np.array(faces)

    def flat_nodes(self, *, x_m: float = 0.0, z_m: float | None = None) -> FloatArray:
        """(N, 3) m: flat on the table, free edge at ``x_m``, at rest height unless ``z_m`` is given."""
        x = np.linspace(0.0, self.length_m, self.rows) + x_m
        y = np.linspace(self.width_m / 2, -self.width_m / 2, self.columns)
        grid = np.stack([*np.meshgrid(x, y, indexing="ij"), np.full((self.rows, self.columns), 0.0)], axis=-1)
        grid[..., 2] = self.margin_m if z_m is None else z_m
        return grid.reshape(-1, 3)

    def hanging_nodes(self, corner_positions: FloatArray) -> FloatArray:
        """(N, 3) m: hanging straight down from two corners (2, 3), as wide as they are apart."""
        down = np.linspace(self.length_m, 0.0, self.rows)[:, None, None] * np.array([0.0, 0.0, -1.0])
        across = np.linspace(corner_positions[0], corner_positions[1], self.columns)[None]
        nodes: FloatArray = across + down
        return nodes.reshape(-1, 3)


CLOTHS: Mapping[str, ClothSpec] = {
    spec.name: spec
    for spec in (
        ClothSpec(
            name="towel", length_m=0.35, width_m=0.35, rows=13, columns=13,
            mass_kg=0.05, elastic_n_m=55.0, damping_n_s_m=0.15, bending_n_m=0.1, rate_hz=200.0,
        ),
        ClothSpec(
            name="napkin", length_m=0.275, width_m=0.215, rows=12, columns=10,
            mass_kg=0.023, elastic_n_m=30.0, damping_n_s_m=0.083, bending_n_m=0.03, rate_hz=200.0,
        ),
        ClothSpec(
            name="towel-fine", length_m=0.35, width_m=0.35, rows=16, columns=16,
            mass_kg=0.05, elastic_n_m=55.0, damping_n_s_m=0.13, bending_n_m=0.08, rate_hz=240.0,
        ),
    )
}  # fmt: skip
"""Cloth 1 and cloth 2 of chapter 3-3-1, and a finer mesh of the first."""


DEFAULT_CLOTH = "towel"


def cloth_spec(name: str, **changes: float) -> ClothSpec:
    """A preset by name, with changes; SimError lists the known ones."""
    if name not in CLOTHS:
        raise SimError(f"unknown cloth {name!r}; the known ones are {', '.join(CLOTHS)}")
    return replace(CLOTHS[name], **changes)  # type: ignore[arg-type]


class Cloth:
    """One cloth in a world."""

    def __init__(self, world: World, spec: ClothSpec, nodes: FloatArray | None = None) -> None:
        """``nodes`` (N, 3) m, world: where it is when it is made, and its shape at rest, so of its spec's size and
        without a fold; None: flat, high in the air.
        """
        self.world = world
        self.spec = spec
        self._triangles = spec.triangles()
        self._rest_area = float(_signed_areas(spec.flat_nodes(), self._triangles).sum())
        self._edges, self._rest_lengths = _edges(spec.flat_nodes(), self._triangles)
        self._last: tuple[float, FloatArray] | None = None
        self._nodes: FloatArray | None = None
        self._nodes_at = 0
        self.body = self._load(spec.flat_nodes(z_m=0.5) if nodes is None else nodes)

    def _load(self, nodes: FloatArray) -> int:
        spec = self.spec
        with mesh_file(nodes, self._triangles) as path:
            body = bullet.loadSoftBody(
                path,
                scale=1.0,
                mass=spec.mass_kg,
                useNeoHookean=0,
                useMassSpring=1,
                useBendingSprings=1,
                springElasticStiffness=spec.elastic_n_m,
                springDampingStiffness=spec.damping_n_s_m,
                springDampingAllDirections=0,
                springBendingStiffness=spec.bending_n_m,
                useSelfCollision=1,
                frictionCoeff=spec.friction,
                useFaceContact=1,
                collisionMargin=spec.margin_m,
                physicsClientId=self.world.client,
            )
        # A cloth that hung still for about a second falls asleep and then ignores its moving anchors.
        bullet.changeDynamics(
            body, -1, activationState=bullet.ACTIVATION_STATE_DISABLE_SLEEPING, physicsClientId=self.world.client
        )
        return int(body)

    def nodes(self) -> FloatArray:
        """(N, 3) m, world, in grid order; read-only."""
        # A step's last nodes are the first of the next.
        if self._nodes is not None and self._nodes_at == self.world.substeps_done:
            return self._nodes
        # Without the flag Bullet gives duplicated render vertices.
        _, vertices = bullet.getMeshData(
            self.body, -1, flags=bullet.MESH_DATA_SIMULATION_MESH, physicsClientId=self.world.client
        )
        # Twice as fast as np.array on a tuple of tuples; the drag of the air asks every 20 ms.
        nodes = np.fromiter(chain.from_iterable(vertices), dtype=float).reshape(-1, 3)
        nodes.setflags(write=False)
        self._nodes, self._nodes_at = nodes, self.world.substeps_done
        return nodes

    def set_nodes(self, nodes: FloatArray) -> None:
        """Put the nodes (N, 3) there; Bullet keeps their velocities and makes this the shape at rest.

        For a cloth that is only looked at: one that is to move as its spec says is made where it begins.
        """
        bullet.resetMeshData(self.body, nodes.tolist(), physicsClientId=self.world.client)
        self._last = None
        self._nodes = None

    def anchor(self, node: int, body: int, link: int = -1) -> int:
        """Fix a node to a link where both are now; returns a constraint for ``release``."""
        return int(bullet.createSoftBodyAnchor(self.body, node, body, link, physicsClientId=self.world.client))

    def release(self, constraint: int) -> None:
        bullet.removeConstraint(constraint, physicsClientId=self.world.client)

    def contact_portion_true(self, nodes: FloatArray) -> float:
        """Share of the cloth that rests on the table, 0..1: see ``resting_share``."""
        return resting_share(nodes, self._triangles, self.spec.margin_m)

    def flat_area(self, nodes: FloatArray) -> float:
        """Signed projected area of the triangles on the table / cloth area; a part on its reverse counts negative.

        A triangle is on the table when its centroid is no higher than a second layer of cloth would lie.
        """
        heights = nodes[self._triangles, 2].mean(axis=1)
        on_table = heights < 3 * self.spec.margin_m + CONTACT_TOLERANCE_M
        return float(_signed_areas(nodes, self._triangles)[on_table].sum() / self._rest_area)

    def layered(self, nodes: FloatArray) -> bool:
        """Whether cloth is folded onto cloth: more than LAYERED_SHARE of the triangles look back, 120 degrees or more.

        Of a cloth that hangs, is laid, or is wrinkled by a stick at most 0.7 % do; of a folded corner 8 to 13 %.
        """
        if not np.isfinite(nodes).all():
            return False  # Diverged; the guard says so at the end of the step.
        a, b, c = (nodes[self._triangles[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), TINY_M)
        mean = normals.mean(axis=0)
        return bool(np.mean(normals @ mean < -0.5 * np.linalg.norm(mean)) > LAYERED_SHARE)

    def stretch(self, nodes: FloatArray) -> FloatArray:
        """(E,) edge length / rest length."""
        ends = nodes[self._edges]
        return np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) / self._rest_lengths

    def divergence_reason(self, nodes: FloatArray) -> str | None:
        """Why the cloth has diverged, or None. Call once a step: a diverging cloth is 10 to 100 times slower."""
        if not np.isfinite(nodes).all():
            return "a node is not finite"
        stretch = float(self.stretch(nodes).max())
        if stretch > STRETCH_LIMIT:
            return f"an edge is stretched {stretch:.2f} times"
        now = self.world.time_s
        last, self._last = self._last, (now, nodes)
        if last is not None and now > last[0]:
            speed = float(np.linalg.norm(nodes - last[1], axis=1).max() / (now - last[0]))
            if speed > SPEED_LIMIT_M_S:
                return f"a node moves at {speed:.1f} m/s"
        return None


@contextmanager
def mesh_file(nodes: FloatArray, triangles: np.ndarray) -> Iterator[str]:
    """Path of an OBJ file of nodes (N, 3) m and triangles (T, 3), there while it is needed.

    Bullet caches OBJ files by path, so each cloth comes from a name that was never used.
    """
    lines = [f"v {x:.9f} {y:.9f} {z:.9f}\n" for x, y, z in nodes]
    lines += [f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in triangles]
    handle, path = tempfile.mkstemp(suffix=".obj")
    try:
        with os.fdopen(handle, "w") as file:
            file.writelines(lines)
        yield path
    finally:
        os.unlink(path)


def resting_share(nodes: FloatArray, triangles: np.ndarray, margin_m: float) -> float:
    """Share of the cloth that rests on the table, by area at rest, 0..1. Blind to folds and stretch: see flat_area.

    ``nodes`` (N, 3) m and ``triangles`` (T, 3), of one size at rest, of a ClothSpec; heights are linear in each. The
    share of nodes would jump by a whole row (1/13) as a cloth is laid, and count a node of the border, which holds
    half a cell, like an inner one: 0.017 off on average, 0.12 at worst.
    """
    return float(_share_below(nodes[triangles, 2], margin_m + CONTACT_TOLERANCE_M).mean())


def _signed_areas(nodes: FloatArray, triangles: np.ndarray) -> FloatArray:
    a, b, c = (nodes[triangles[:, k], :2] for k in range(3))
    u, v = b - a, c - a
    return 0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])


def _share_below(heights: FloatArray, level: float) -> FloatArray:
    """(T,) share of each triangle's area below ``level``; ``heights`` (T, 3) of its corners, linear in between.

    The triangle that the level cuts off at the lowest corner, or, above the middle one, all but that at the highest.
    """
    low, middle, high = np.sort(heights, axis=1).T
    span = np.maximum(high - low, TINY_M)
    below = np.maximum(level - low, 0.0) ** 2 / (span * np.maximum(middle - low, TINY_M))
    above = 1.0 - np.maximum(high - level, 0.0) ** 2 / (span * np.maximum(high - middle, TINY_M))
    share: FloatArray = np.clip(np.where(level <= middle, below, above), 0.0, 1.0)
    return share


def _edges(nodes: FloatArray, triangles: np.ndarray) -> tuple[np.ndarray, FloatArray]:
    pairs = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    edges = np.unique(pairs, axis=0)
    return edges, np.linalg.norm(nodes[edges[:, 0]] - nodes[edges[:, 1]], axis=1)
