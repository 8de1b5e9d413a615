"""MeshMaker: a smooth surface through the cloth's nodes, to draw it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.spec import ClothSpec

MIN_HEIGHT_M = 0.0015
"""The curve between two nodes may dip below both; nothing is drawn inside the table."""
SUNKEN_M = 0.012
"""Bullet lets nodes sink into the table for moments, by up to 9 mm where a cloth is blown or thrown onto it. Less
deep nodes are drawn on the table, which would show through the cloth; cloth that hangs beside the table is deeper."""
LOWEST_M = 0.0003
"""Nodes that rest lower are drawn at this height."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ClothMesh:
    """A triangle mesh of V vertices."""

    vertices: FloatArray
    """Positions, (V, 3) m, world."""
    normals: FloatArray
    """Unit vectors out of the face (up when laid flat), (V, 3)."""
    triangles: NDArray[np.intp]
    """Vertex indices, (T, 3), counter-clockwise seen from the face."""


class MeshMaker:
    """Cubic (Catmull-Rom) curves through the nodes along both directions of the grid; the nodes stay where they are."""

    def __init__(self, spec: ClothSpec, *, subdivisions: int = 2) -> None:
        self._shape = (spec.rows, spec.columns)
        self._along = _catmull_rom(spec.rows, subdivisions)
        self._across = _catmull_rom(spec.columns, subdivisions)
        fine = replace(spec, rows=len(self._along), columns=len(self._across))
        self._triangles: NDArray[np.intp] = fine.triangles()

    def mesh(self, nodes: FloatArray) -> ClothMesh:
        """Return the surface through ``nodes`` (N, 3), which are in grid order."""
        coarse = nodes.reshape(*self._shape, 3)
        fine = np.einsum("ai,ijk,bj->abk", self._along, coarse, self._across, optimize=True)
        low = np.clip(nodes[:, 2].min(), LOWEST_M, MIN_HEIGHT_M)
        height = fine[..., 2]
        fine[..., 2] = np.where(height > -SUNKEN_M, np.maximum(height, low), height)
        # Rows run along +x and columns along -y, so up is (d/dcolumn) x (d/drow).
        normals = np.cross(np.gradient(fine, axis=1), np.gradient(fine, axis=0))
        normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
        return ClothMesh(vertices=fine.reshape(-1, 3), normals=normals.reshape(-1, 3), triangles=self._triangles)


def _catmull_rom(count: int, subdivisions: int) -> FloatArray:
    """Return the weights (F, count) of ``count`` points in F = (count - 1) * subdivisions + 1 points of their curve."""
    at = np.arange((count - 1) * subdivisions + 1) / subdivisions
    start = np.minimum(at.astype(int), count - 2)
    t = at - start
    # Beyond the ends the curve continues straight: p[-1] = 2 p[0] - p[1].
    extend = np.zeros((count + 2, count))
    extend[1:-1] = np.eye(count)
    extend[0, :2], extend[-1, -2:] = (2, -1), (-1, 2)
    basis = 0.5 * np.stack(
        [-(t**3) + 2 * t**2 - t, 3 * t**3 - 5 * t**2 + 2, -3 * t**3 + 4 * t**2 + t, t**3 - t**2], axis=1
    )
    weights: FloatArray = np.einsum("fk,fkc->fc", basis, extend[start[:, None] + np.arange(4)])
    return weights
