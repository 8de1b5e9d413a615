"""Descriptor protocol: from a view of the cloth to numbers and a wrinkle direction."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from layflat.perception.arrays import Float64Array
from layflat.perception.camera.rectified_view import ClothView


@dataclass(frozen=True, kw_only=True, eq=False)
class WrinkleDirection:
    """Direction to pull the wrinkles out, and its quality. Without wrinkles all numbers are 0, never NaN."""

    vector: Float64Array
    """(2,) unit vector in table coordinates, x >= 0, perpendicular to most wrinkles; zeros if there is no direction."""
    coherence: float
    """Agreement on one axis: 1 if all responses are in one orientation, 0 if all orientations respond alike."""
    strength: float
    """Depth of the wrinkles in the descriptor's own unit, >= 0; 0 if there is no direction."""

    @classmethod
    def none(cls) -> WrinkleDirection:
        """Return the value for no wrinkles or no cloth."""
        return cls(vector=np.zeros(2), coherence=0.0, strength=0.0)


@runtime_checkable
class Descriptor(Protocol):
    """Turns a view of the cloth into a vector of fixed length, and into the direction that this vector implies."""

    @property
    def name(self) -> str:
        """Name in files and tables."""

    @property
    def size(self) -> int:
        """Length of the vector."""

    def describe(self, view: ClothView) -> Float64Array:
        """Return (size,) finite numbers; all zeros for a view without cloth."""

    def direction(self, view: ClothView) -> WrinkleDirection:
        """Return the wrinkle contraction direction; none for a flat, lifted or absent cloth."""


def wrinkle_normals(orientations: int) -> Float64Array:
    """Return (n, 2) v_i of Eq. 3-3: unit perpendiculars, x >= 0, of wrinkle directions i pi / n, table coordinates.

    Wrinkles along x (theta_0) have two perpendiculars with x = 0; +y is taken.
    """
    theta = np.arange(orientations) * math.pi / orientations
    normals = np.column_stack([np.sin(theta), -np.cos(theta)])
    normals[0] = (0.0, 1.0)
    normals.setflags(write=False)
    return normals


def filter_angles(orientations: int) -> tuple[float, ...]:
    """Return the angles of the filters' stripe normals for ``wrinkle_normals``: the view's rows run against y."""
    return tuple(-math.atan2(y, x) for x, y in wrinkle_normals(orientations))


def axial_mean(weights: Float64Array, normals: Float64Array) -> tuple[Float64Array, float]:
    """Return the weighted mean axis (2,), x >= 0, and its coherence in 0..1: angles are doubled, averaged and halved.

    ``weights`` (n,) >= 0 are not all 0; the signs of the unit vectors ``normals`` (n, 2) do not matter.
    """
    total = np.sum(weights * (normals[:, 0] + 1j * normals[:, 1]) ** 2)
    half = math.atan2(total.imag, total.real) / 2
    return np.array([max(0.0, math.cos(half)), math.sin(half)]), float(abs(total) / weights.sum())
