"""The seam between a view of the cloth and numbers: what every descriptor of wrinkles gives."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from layflat.perception.camera.rectified_view import ClothView


@dataclass(frozen=True, kw_only=True, eq=False)
class WrinkleDirection:
    """Which way to pull the wrinkles out, and what that is worth. Without wrinkles all numbers are 0, never NaN."""

    vector: NDArray[np.float64]
    """(2,) unit vector in table coordinates (x, y), x >= 0, perpendicular to most wrinkles; zeros: no direction."""
    coherence: float
    """0..1: how far the orientations agree on one axis; 1 where all responses are in one, 0 where they are equal."""
    strength: float
    """>= 0: depth of the wrinkles in the descriptor's own unit; 0 where there is no direction."""

    @classmethod
    def none(cls) -> WrinkleDirection:
        """No wrinkles, or no cloth."""
        return cls(vector=np.zeros(2), coherence=0.0, strength=0.0)


@runtime_checkable
class Descriptor(Protocol):
    """Turns a view of the cloth into a vector of fixed length, and into the direction that this vector implies."""

    @property
    def name(self) -> str:
        """As in files and tables."""

    @property
    def size(self) -> int:
        """Length of the vector."""

    def describe(self, view: ClothView) -> NDArray[np.float64]:
        """(size,) finite numbers; all zeros for a view without cloth."""

    def direction(self, view: ClothView) -> WrinkleDirection:
        """The wrinkle contraction direction by this descriptor; none on a flat, a lifted or an absent cloth."""


def wrinkle_normals(orientations: int) -> NDArray[np.float64]:
    """(n, 2) v_i of Eq. 3-3: of the two unit perpendiculars of wrinkle direction i pi / n the one with x >= 0.

    Table coordinates. Wrinkles along x (theta_0) have two perpendiculars with x = 0; +y is taken.
    """
    theta = np.arange(orientations) * math.pi / orientations
    normals = np.column_stack([np.sin(theta), -np.cos(theta)])
    normals[0] = (0.0, 1.0)
    normals.setflags(write=False)
    return normals


def axial_mean(weights: NDArray[np.float64], normals: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Weighted mean (2,) of axes, x >= 0, and its coherence in 0..1: angles are doubled, averaged and halved.

    ``weights`` (n,) >= 0, not all 0; ``normals`` (n, 2) unit vectors, of which the sign does not matter.
    """
    total = np.sum(weights * (normals[:, 0] + 1j * normals[:, 1]) ** 2)
    half = math.atan2(total.imag, total.real) / 2
    return np.array([max(0.0, math.cos(half)), math.sin(half)]), float(abs(total) / weights.sum())
