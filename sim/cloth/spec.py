"""ClothSpec: the size, mesh and material of a cloth.

A cloth is a row-major grid: row 0 is the free edge, the last row is held, column 0 lies at +y. Laid flat, row i lies at
x = i / (rows - 1) * length, its face up. Each cell has two triangles, with alternating diagonals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.cloth_frame import NOMINAL_M, home_x_m
from layflat.sim.errors import SimError

HELD_STRETCH = 1.03
"""Usual distance of the held corners / width of the cloth: a taut hem does not flop to a side."""
DEFAULT_CLOTH = "towel"


@dataclass(frozen=True, kw_only=True)
class ClothSpec:
    """Size, mesh and material of a cloth. Stiffness and damping are per spring, so they belong to one node count."""

    name: str
    length_m: float
    """Length along x when flat, from the free edge to the held edge."""
    width_m: float
    """Width along y, between the two held corners."""
    rows: int
    columns: int
    mass_kg: float
    elastic_n_m: float
    damping_n_s_m: float
    """Springs are explicit and damping is implicit: keep it above elastic * step / 2."""
    bending_n_m: float
    friction: float = 0.5
    margin_m: float = 0.004
    """Half the distance that the engine keeps between cloth and cloth; the cloth rests at this height."""
    rate_hz: float = 240.0
    """Physics steps per second."""
    held_stretch: float = HELD_STRETCH
    """Distance at which a robot holds the corners / width: the robot's doing, not the cloth's."""

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
    def n_nodes(self) -> int:
        """Number of nodes, N."""
        return self.rows * self.columns

    @property
    def held_width_m(self) -> float:
        """Distance at which a robot holds the two corners."""
        return self.held_stretch * self.width_m

    @property
    def home_x_m(self) -> float:
        """World x over which the free edge hangs before a start's moves."""
        return home_x_m(self.length_m)

    @property
    def size(self) -> float:
        """How much longer or wider than the towel it is, at least 1: by so much more the camera sees."""
        return max(1.0, self.length_m / NOMINAL_M, self.width_m / NOMINAL_M)

    @property
    def corners(self) -> tuple[int, int]:
        """Held nodes: corner 1 (+y), corner 2 (-y)."""
        return (self.rows - 1) * self.columns, self.rows * self.columns - 1

    def triangles(self) -> np.ndarray:
        """Return node indices, (T, 3), counter-clockwise seen from above when flat with the face up."""
        faces = []
        for i in range(self.rows - 1):
            for j in range(self.columns - 1):
                a, b = i * self.columns + j, i * self.columns + j + 1
                c, d = a + self.columns, b + self.columns
                faces += [(a, b, c), (b, d, c)] if (i + j) % 2 else [(a, d, c), (a, b, d)]
        return np.array(faces)

    def flat_nodes(self, *, x_m: float = 0.0, z_m: float | None = None) -> FloatArray:
        """Return the nodes (N, 3) m of a flat cloth, free edge at ``x_m``, at rest height unless ``z_m`` is given."""
        x = np.linspace(0.0, self.length_m, self.rows) + x_m
        y = np.linspace(self.width_m / 2, -self.width_m / 2, self.columns)
        grid = np.stack([*np.meshgrid(x, y, indexing="ij"), np.full((self.rows, self.columns), 0.0)], axis=-1)
        grid[..., 2] = self.margin_m if z_m is None else z_m
        return grid.reshape(-1, 3)

    def hanging_nodes(self, corner_positions: FloatArray) -> FloatArray:
        """Return the nodes (N, 3) m of a cloth that hangs from two corners (2, 3) m, as wide as they are apart."""
        down = np.linspace(self.length_m, 0.0, self.rows)[:, None, None] * np.array([0.0, 0.0, -1.0])
        across = np.linspace(corner_positions[0], corner_positions[1], self.columns)[None]
        nodes: FloatArray = across + down
        return nodes.reshape(-1, 3)

    def corners_at(self, x_m: float, z_m: float) -> FloatArray:
        """Return where a robot holds the corners (2, 3) m when their midpoint is at ``x_m``, 0, ``z_m``."""
        half = self.held_stretch * self.width_m / 2
        return np.array([[x_m, half, z_m], [x_m, -half, z_m]])
