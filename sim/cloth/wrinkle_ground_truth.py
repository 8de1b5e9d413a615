"""Direction of a cloth's wrinkles from its mesh: the truth with which a camera's descriptors are compared."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from scipy.interpolate import CubicSpline

from layflat.data.arrays import FloatArray
from layflat.perception.descriptors.base import axial_mean
from layflat.sim.cloth.geometry import resting_share
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.errors import SimError

MAX_HEIGHT_M = 0.03
"""Cloth above this is held or folded up, not wrinkled."""
FOOT_CELLS = 2
"""Distance from such cloth, along the cloth, within which it still rises to there."""
MAX_SLOPE = 1.0
"""Cap of the slope, 45 degrees, so that one upright crease does not outweigh the rest."""
MIN_ENERGY = 1e-3
"""Energy below which a cloth is flat: a slope of 1.8 degrees rms."""
MIN_SHARE = 0.05
"""Share of the cloth on the table below which there is no direction."""
SAMPLES_PER_CELL = 3
"""Samples along each side. The mesh's own triangles would not do: waves of 2.5 cells, the shortest ones, are cut more
along a cell's side than along its diagonal, which turns them by up to 10 degrees; the spline by at most 2.2."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WrinkleTruth:
    """Wrinkles of a mesh; never NaN."""

    direction: FloatArray
    """Unit vector across most wrinkles, (2,), table coordinates, x >= 0; zeros on a flat or a lifted cloth."""
    coherence: float
    """Agreement of the slopes on one axis, 0..1: difference of the structure tensor's eigenvalues over their sum."""
    energy: float
    """Mean squared slope of what lies on the table, >= 0; 0 where nothing does."""
    share: float
    """Area of what lies on the table, seen from above, over the cloth's area, >= 0."""
    contact_portion: float
    """Share of the cloth that rests on the table, 0..1, as in `ClothGeometry.contact_portion_true`."""

    def __post_init__(self) -> None:
        self.direction.setflags(write=False)


def wrinkle_truth(nodes: FloatArray, spec: ClothSpec) -> WrinkleTruth:
    """Return the strongest axis of the structure tensor of the height of ``nodes`` (N, 3) m: J = sum(A g g^T).

    g = (dz/dx, dz/dy) at the samples of the smooth surface through the nodes, A the area around each seen from above.
    Only samples that lie take part: below MAX_HEIGHT_M, not at the foot of what is above, and with the face up, since
    what is folded over shows its reverse.
    """
    if nodes.shape != (spec.rows * spec.columns, 3):
        raise SimError(f"nodes have shape {nodes.shape}; cloth {spec.name} has {(spec.rows * spec.columns, 3)}")
    area, slope = _lying(nodes.reshape(spec.rows, spec.columns, 3))
    contact = resting_share(nodes, spec.triangles(), spec.margin_m)
    steepness = np.linalg.norm(slope, axis=1)
    total = float(area.sum())
    energy = float((area * steepness**2).sum()) / total if total > 0 else 0.0
    share = total / spec.area_m2
    direction, coherence = np.zeros(2), 0.0
    if energy > MIN_ENERGY and share > MIN_SHARE:
        steep = steepness > 0
        direction, coherence = axial_mean((area * steepness**2)[steep], slope[steep] / steepness[steep, None])
    return WrinkleTruth(direction=direction, coherence=coherence, energy=energy, share=share, contact_portion=contact)


def _lying(grid: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the area from above (K,) m^2 and the capped slope (K, 2) of each sample that lies on the table."""
    rows, along = _spline(grid.shape[0])
    columns, across = _spline(grid.shape[1])
    height = np.einsum("ai,ij,bj->ab", rows, grid[..., 2], columns, optimize=True)
    # Rows run along +x and columns along -y, so up is (d/dcolumn) x (d/drow).
    d_row = np.einsum("ai,ijk,bj->abk", along, grid, columns, optimize=True)
    d_column = np.einsum("ai,ijk,bj->abk", rows, grid, across, optimize=True)
    normal = np.cross(d_column, d_row)
    foot = np.ones((2 * FOOT_CELLS * SAMPLES_PER_CELL + 1,) * 2, dtype=np.uint8)
    lifted = cv2.dilate((height >= MAX_HEIGHT_M).astype(np.uint8), foot) > 0
    lying = (normal[..., 2] > 0) & ~lifted
    slope = -normal[lying, :2] / normal[lying, 2:]
    steepness = np.linalg.norm(slope, axis=1, keepdims=True)
    return normal[lying, 2] / SAMPLES_PER_CELL**2, slope * (MAX_SLOPE / np.maximum(steepness, MAX_SLOPE))


@lru_cache(maxsize=8)
def _spline(count: int) -> tuple[FloatArray, FloatArray]:
    """Return the weights (F, count) of ``count`` points in the values and in the slopes of their natural cubic."""
    at = (np.arange((count - 1) * SAMPLES_PER_CELL) + 0.5) / SAMPLES_PER_CELL
    spline = CubicSpline(np.arange(count), np.eye(count), bc_type="natural")
    return spline(at), spline(at, 1)
