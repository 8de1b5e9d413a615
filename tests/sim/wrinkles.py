"""Cloth put into wrinkles of one direction, and the direction that a mesh's wrinkles really have."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from layflat.data.arrays import FloatArray
from layflat.perception.descriptors.base import axial_mean
from layflat.sim.cloth.spec import ClothSpec
from layflat.tests.sim.helpers import cloth_in_world, run

CENTRE_M = (0.20, 0.0)
"""Middle of a wrinkled cloth."""
MIN_ENERGY = 1e-3
"""Energy below which a cloth is flat: a slope of 1.8 degrees rms."""
SAMPLES_PER_CELL = 3
"""Samples along each side. The mesh's own triangles would turn waves of 2.5 cells by up to 10 degrees, since a cell's
sides cut them more than its diagonal does; the spline turns them by at most 2.2."""


@dataclass(frozen=True, kw_only=True)
class Wrinkling:
    """A sine: height = amplitude (1 - cos(2 pi across / wavelength + phase)) above the table."""

    normal_rad: float
    """Angle of the wrinkles' perpendicular from +x, table coordinates."""
    wavelength_m: float
    """Wavelength on the table. A mesh shows wrinkles of 2.5 of its cells and longer."""
    amplitude_m: float
    phase_rad: float = 0.0

    @classmethod
    def random(cls, rng: np.random.Generator, spec: ClothSpec, normal_rad: float) -> Wrinkling:
        """Draw a wavelength of 2.5 to 3.1 cells, an amplitude of 8.5 to 12.5 % of it, and any phase."""
        length = float(rng.uniform(2.5, 3.1)) * max(spec.length_m / (spec.rows - 1), spec.width_m / (spec.columns - 1))
        amplitude = float(rng.uniform(0.085, 0.125)) * length
        phase = float(rng.uniform(0.0, 2 * math.pi))
        return cls(normal_rad=normal_rad, wavelength_m=length, amplitude_m=amplitude, phase_rad=phase)


def wrinkled_nodes(spec: ClothSpec, wrinkling: Wrinkling) -> FloatArray:
    """Return nodes (N, 3) m about CENTRE_M, lowest at rest height, drawn together so that lengths are kept."""
    flat = spec.flat_nodes()[:, :2]
    flat = flat - flat.mean(axis=0)
    normal = np.array([math.cos(wrinkling.normal_rad), math.sin(wrinkling.normal_rad)])
    reach = float(np.hypot(spec.length_m, spec.width_m))
    across = np.linspace(-reach, reach, 20001)
    turn = 2 * math.pi / wrinkling.wavelength_m
    slope = wrinkling.amplitude_m * turn * np.sin(turn * across + wrinkling.phase_rad)
    arc = np.cumsum(np.sqrt(1 + slope**2)) * (across[1] - across[0])
    arc -= np.interp(0.0, across, arc)
    material = flat @ normal
    place = np.interp(material, arc, across)
    height = wrinkling.amplitude_m * (1 - np.cos(turn * place + wrinkling.phase_rad))
    table = flat + (place - material)[:, None] * normal + CENTRE_M
    return np.column_stack([table, spec.margin_m + height])


def settled_wrinkles(spec: ClothSpec, wrinkling: Wrinkling, *, table_friction: float = 1.0) -> FloatArray:
    """Return the nodes (N, 3) m that 0.3 s of physics make of `wrinkled_nodes`.

    Nodes that are set are the shape at rest: the wrinkles stay, eased by gravity and the table.
    """
    with cloth_in_world(spec, wrinkled_nodes(spec, wrinkling), table_friction=table_friction) as cloth:
        run(cloth.world, round(0.3 * spec.rate_hz))
        assert cloth.divergence_reason(cloth.nodes()) is None
        return cloth.nodes()


class WrinkleTruth(NamedTuple):
    """Wrinkles of a mesh that lies on the table with its face up."""

    direction: FloatArray
    """Unit vector across most wrinkles, (2,), table coordinates, x >= 0; zeros on a flat cloth."""
    coherence: float
    """Agreement of the slopes on one axis, 0..1: difference of the structure tensor's eigenvalues over their sum."""
    energy: float
    """Mean squared slope, >= 0."""


def wrinkle_truth(nodes: FloatArray, spec: ClothSpec) -> WrinkleTruth:
    """Return the strongest axis of the structure tensor of the height of ``nodes`` (N, 3) m: J = sum(A g g^T).

    g = (dz/dx, dz/dy) at the samples of the smooth surface through the nodes, A the area around each seen from above.
    """
    grid = nodes.reshape(spec.rows, spec.columns, 3)
    rows, along = _spline(spec.rows)
    columns, across = _spline(spec.columns)
    # Rows run along +x and columns along -y, so up is (d/dcolumn) x (d/drow).
    d_row = np.einsum("ai,ijk,bj->abk", along, grid, columns, optimize=True)
    d_column = np.einsum("ai,ijk,bj->abk", rows, grid, across, optimize=True)
    normal = np.cross(d_column, d_row).reshape(-1, 3)
    area, slope = normal[:, 2], -normal[:, :2] / normal[:, 2:]
    steepness = np.linalg.norm(slope, axis=1)
    weights = area * steepness**2
    energy = float(weights.sum() / area.sum())
    direction, coherence = np.zeros(2), 0.0
    if energy > MIN_ENERGY:
        steep = steepness > 0
        direction, coherence = axial_mean(weights[steep], slope[steep] / steepness[steep, None])
    return WrinkleTruth(direction, coherence, energy)


@lru_cache(maxsize=8)
def _spline(count: int) -> tuple[FloatArray, FloatArray]:
    """Return the weights (F, count) of ``count`` points in the values and in the slopes of their natural cubic."""
    at = (np.arange((count - 1) * SAMPLES_PER_CELL) + 0.5) / SAMPLES_PER_CELL
    spline = CubicSpline(np.arange(count), np.eye(count), bc_type="natural")
    return spline(at), spline(at, 1)


def axis_error(direction: FloatArray, angle: float) -> float:
    """Return the angle between a vector and an axis at ``angle`` rad, 0..90 degrees."""
    apart = math.degrees(math.atan2(direction[1], direction[0]) - angle) % 180
    return min(apart, 180 - apart)
