"""Which way a cloth's wrinkles run, from its mesh: the truth that a camera's descriptors are measured against."""

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
"""Cloth above this is held or folded up, not wrinkled ..."""
FOOT_CELLS = 2
"""... and as far as this around it, along the cloth, rises to there."""
MAX_SLOPE = 1.0
"""What is steeper counts as if it rose by 45 degrees, lest one upright crease outweigh all the rest."""
MIN_ENERGY = 1e-3
"""Below this, a slope of 1.8 degrees rms, a cloth is flat."""
MIN_SHARE = 0.05
"""Nor is there a direction if less of the cloth than this lies on the table."""
SAMPLES_PER_CELL = 3
"""Along each side. The mesh's own triangles would not do: waves of 2.5 cells, the shortest that a mesh shows, are cut
more along a cell's side than along its diagonal, which turns them by up to 10 degrees; the spline by at most 2.2."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WrinkleTruth:
    """What the nodes say about wrinkles; never NaN."""

    direction: FloatArray
    """(2,) unit vector in table coordinates, x >= 0, across most wrinkles; zeros on a flat or a lifted cloth."""
    coherence: float
    """0..1: how far the slopes agree on one axis: difference of the structure tensor's eigenvalues over their sum."""
    energy: float
    """>= 0: mean squared slope of what lies on the table, dimensionless; 0 where nothing does."""
    share: float
    """>= 0: the area of that, seen from above, over the cloth's area."""
    contact_portion: float
    """0..1: share of the cloth that rests on the table, as ``Cloth.contact_portion_true``."""

    def __post_init__(self) -> None:
        self.direction.setflags(write=False)


def wrinkle_truth(nodes: FloatArray, spec: ClothSpec) -> WrinkleTruth:
    """Structure tensor of the height of ``nodes`` (N, 3) m: J = sum(A g g^T); its strongest axis is the direction.

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
    """(K,) m^2 and (K, 2): area seen from above and capped slope of each sample that lies on the table."""
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
    """(F, count) weights of ``count`` points in the values, and in the slopes, of the natural cubic through them."""
    at = (np.arange((count - 1) * SAMPLES_PER_CELL) + 0.5) / SAMPLES_PER_CELL
    spline = CubicSpline(np.arange(count), np.eye(count), bc_type="natural")
    return spline(at), spline(at, 1)
