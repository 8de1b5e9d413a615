"""Quality of a simulated cloth: what the two tests of its fabric give, and whether it hangs, rests and folds well.

Each test runs in a world of its own and takes under two seconds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.spec import HELD_STRETCH, ClothSpec
from layflat.sim.errors import SimError
from layflat.sim.physics.base import Cloth, World
from layflat.sim.physics.registry import DEFAULT_PHYSICS, cloth_world

HANG_S = 1.6
"""Time in which a hanging cloth comes to rest; the last fifth of it is averaged."""
STRIP_COLUMNS, STRIP_HELD = 5, 3
"""Nodes across the strip of a cantilever test, and its rows that are clamped."""
TEST_ANGLE_DEG = 41.5
"""Angle below the horizontal at which the overhang is twice the bending length (ISO 9073-7)."""
MOST_CELLS = 4
"""Longest overhang of a strip, in cells of the mesh."""
SAG_M, PENETRATION_M, REST_M = 0.010, 0.0015, 0.001
"""Most that a held hem sags, that a falling cloth sinks into the table, and that it rests above its margin."""
FALL_M = 0.03
FOLD_S = 1.2


class ClothDivergedError(SimError):
    """A cloth that merely hangs or falls diverges."""


@dataclass(frozen=True, kw_only=True)
class ClothQuality:
    """Measures of a cloth; ``problems`` says in words which of them fail."""

    hanging_stretch: float
    bending_length_m: float
    hem_sag_m: float
    penetration_m: float
    rest_height_m: float
    fold_diverges: str | None
    """Why a cloth that is folded in half and drawn open diverges; None where it does not."""

    @property
    def problems(self) -> tuple[str, ...]:
        """Sentences about what fails."""
        found = []
        if self.hem_sag_m > SAG_M:
            found.append(f"the hem sags by {1000 * self.hem_sag_m:.1f} mm; at most {1000 * SAG_M:g} mm are good")
        if self.penetration_m > PENETRATION_M:
            found.append(
                f"it sinks {1000 * self.penetration_m:.1f} mm into the table; "
                f"at most {1000 * PENETRATION_M:g} mm are good"
            )
        if self.rest_height_m > REST_M:
            found.append(f"it rests {1000 * self.rest_height_m:.1f} mm above where cloth should lie")
        if self.fold_diverges is not None:
            found.append(f"folded, it diverges: {self.fold_diverges}")
        return tuple(found)


def measure(spec: ClothSpec, physics: str = DEFAULT_PHYSICS) -> ClothQuality:
    """Run all tests; ClothDivergedError where the cloth diverges as it merely hangs."""
    penetration, rest = fall(spec, physics)
    return ClothQuality(
        hanging_stretch=hanging_stretch(spec, physics),
        bending_length_m=bending_length_m(spec, physics),
        hem_sag_m=hem_sag_m(spec, physics),
        penetration_m=penetration,
        rest_height_m=rest,
        fold_diverges=fold(spec, physics),
    )


def hanging_stretch(spec: ClothSpec, physics: str = DEFAULT_PHYSICS) -> float:
    """Return the share by which the cloth gets longer under its own weight, hung from its whole held edge."""
    side, up = spec.width_m / 2, spec.length_m + 0.2
    nodes = spec.hanging_nodes(np.array([[0.0, side, up], [0.0, -side, up]]))
    grid = _held(spec, nodes, range((spec.rows - 1) * spec.columns, spec.n_nodes), physics)
    return float(np.linalg.norm(np.diff(grid, axis=0), axis=2).sum(axis=0).mean() / spec.length_m - 1.0)


def bending_length_m(spec: ClothSpec, physics: str = DEFAULT_PHYSICS) -> float:
    """Return the bending length along x by a cantilever test on a strip with the mesh's cells and springs.

    The overhang of TEST_ANGLE_DEG lies between two whole numbers of cells; where already one cell droops further, or
    MOST_CELLS droop less, Peirce's formula gives it from that one.
    """
    cell = spec.length_m / (spec.rows - 1)
    before = 0.0
    for cells in range(1, MOST_CELLS + 1):
        angle = droop_deg(spec, cells, physics)
        if angle >= TEST_ANGLE_DEG and cells > 1:
            share = (TEST_ANGLE_DEG - before) / max(angle - before, 1e-9)
            return float(cell * (cells - 1 + np.clip(share, 0.0, 1.0)) / 2)
        if angle >= TEST_ANGLE_DEG or cells == MOST_CELLS:
            break
        before = angle
    radians = np.radians(angle)
    return float(cells * cell * (np.cos(radians / 2) / (8 * np.tan(radians))) ** (1 / 3))


def droop_deg(spec: ClothSpec, cells: int, physics: str = DEFAULT_PHYSICS) -> float:
    """Return the angle below the horizontal at which the tip of a strip hangs that overhangs by ``cells`` cells."""
    rows, columns = STRIP_HELD + cells, STRIP_COLUMNS
    strip = replace(
        spec,
        rows=rows,
        columns=columns,
        length_m=spec.length_m * (rows - 1) / (spec.rows - 1),
        width_m=spec.width_m * (columns - 1) / (spec.columns - 1),
        mass_kg=spec.mass_kg * rows * columns / spec.n_nodes,
    )
    grid = _held(strip, strip.flat_nodes(z_m=0.5), range((rows - STRIP_HELD) * columns, rows * columns), physics)
    reach = grid[0].mean(axis=0) - grid[cells].mean(axis=0)
    return float(np.degrees(np.arctan2(-reach[2], np.hypot(reach[0], reach[1]))))


def hem_sag_m(spec: ClothSpec, physics: str = DEFAULT_PHYSICS) -> float:
    """Return how far the hems of a cloth hang below their ends, held by two corners as a robot holds it."""
    corners = spec.corners_at(0.0, 0.12 + spec.length_m)
    nodes = spec.hanging_nodes(corners / [1.0, HELD_STRETCH, 1.0])
    grid = _held(spec, nodes, spec.corners, physics, apart=HELD_STRETCH)
    return float(max(hem[[0, -1], 2].max() - hem[:, 2].min() for hem in (grid[0], grid[-1])))


def fall(spec: ClothSpec, physics: str = DEFAULT_PHYSICS) -> tuple[float, float]:
    """Let a flat cloth fall; return how deep it sinks into the table, and how far above its margin it then lies, m."""
    heights = [nodes[:, 2] for nodes in _run(spec, spec.flat_nodes(z_m=FALL_M), 0.7, physics)]
    return max(0.0, -float(np.min(heights))), max(0.0, float(heights[-1].max()) - spec.margin_m)


def fold(spec: ClothSpec, physics: str = DEFAULT_PHYSICS) -> str | None:
    """Lay the free edge over the cloth's middle and lift it again; return why the cloth diverges, or None."""
    with closing(cloth_world(physics, spec)) as world:
        cloth = world.add_cloth(spec, spec.flat_nodes(z_m=spec.margin_m + 0.001))
        world.add_air(cloth)
        held = list(range(spec.columns))
        places = cloth.nodes()[held]
        holders = world.add_holders(places)
        holders.grasp(cloth, held)
        radius, steps = 0.3 * spec.length_m, round(FOLD_S / world.coarse_substep_s)
        for turn in (*np.linspace(0.0, np.pi, steps), *np.linspace(np.pi, 0.3 * np.pi, steps)):
            offset = np.array([radius * (1 - np.cos(turn)), 0.0, radius * np.sin(turn) + 3 * spec.margin_m])
            wanted = places + offset
            holders.move(wanted.tolist(), [[0.0, 0.0, 0.0]] * len(held))
            world.begin_substep()
            world.step()
            reason = _divergence(cloth)
            if reason is not None:
                return reason
    return None


def _divergence(cloth: Cloth) -> str | None:
    nodes = cloth.nodes()
    if not np.isfinite(nodes).all():
        return "a node is not finite"
    stretch = float(cloth.stretch(nodes).max())
    return f"an edge is stretched {stretch:.2f} times" if stretch > 1.5 else None


def _held(spec: ClothSpec, nodes: FloatArray, held: Sequence[int], physics: str, *, apart: float = 1.0) -> FloatArray:
    """Return the nodes, (rows, columns, 3) m, of a cloth that hangs at rest from ``held``, drawn ``apart`` along y."""
    places = nodes[list(held)]
    targets = places * [1.0, apart, 1.0]

    def prepare(world: World, cloth: Cloth) -> Iterator[None]:
        holders = world.add_holders(places)
        holders.grasp(cloth, held)
        for share in np.linspace(0.0, 1.0, round(0.25 / world.coarse_substep_s)) if apart != 1.0 else ():
            holders.move((places + share * (targets - places)).tolist(), [[0.0, 0.0, 0.0]] * len(places))
            yield
        while True:
            holders.stop()
            yield

    seen = list(_run(spec, nodes, HANG_S, physics, prepare))
    return np.mean(seen[-len(seen) // 5 :], axis=0).reshape(spec.rows, spec.columns, 3)


def _run(
    spec: ClothSpec,
    nodes: FloatArray,
    duration_s: float,
    physics: str,
    prepare: Callable[[World, Cloth], Iterator[None]] | None = None,
) -> Iterator[FloatArray]:
    """Yield the nodes of a cloth after every fourth substep; ClothDivergedError where it diverges."""
    with closing(cloth_world(physics, spec)) as world:
        cloth = world.add_cloth(spec, nodes)
        world.add_air(cloth)
        hold: Iterator[None] = iter(()) if prepare is None else prepare(world, cloth)
        for step in range(round(duration_s / world.coarse_substep_s)):
            next(hold, None)
            world.begin_substep()
            world.step()
            if step % 4 == 3:
                reason = _divergence(cloth)
                if reason is not None:
                    raise ClothDivergedError(f"cloth {spec.name} diverges while it hangs or falls: {reason}")
                yield cloth.nodes().copy()
