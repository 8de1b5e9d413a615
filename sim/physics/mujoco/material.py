"""The sheet that a cloth's springs amount to: membrane and bending stiffness.

A `ClothSpec` describes a fabric by the springs with which Bullet simulates it. Here they become constants of a sheet
that stretches as much where it hangs, and has the same bending length in the same test. How well it does:
docs/explanation/results/engines.md.
"""

from __future__ import annotations

import math

from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.physics.base import GRAVITY_M_S2

MEMBRANE = 1.5
"""Membrane stiffness / stiffness of a spring along the threads: the diagonals help it."""
BENDING_HELPS = 4.0
"""The same of the bending springs: twice as long, and two of them side by side."""
BENDING_CELLS = 0.76
"""Bending length of a sheet, in cells of the mesh, whose springs' stiffness is its weight on a cell's length."""
BENDING_POWER = 1 / 6
"""Power of the bending springs' stiffness in the bending length; its cube is in the sheet's stiffness."""


def membrane_n_m(spec: ClothSpec) -> float:
    """Return Young's modulus * thickness."""
    return MEMBRANE * spec.elastic_n_m + BENDING_HELPS * spec.bending_n_m


def bending_n_m(spec: ClothSpec) -> float:
    """Return the bending stiffness, N m: weight of an area * bending length cubed (Peirce 1930)."""
    weight_n_m2 = spec.mass_kg * GRAVITY_M_S2 / (spec.length_m * spec.width_m)
    cell = math.sqrt(spec.length_m * spec.width_m / ((spec.rows - 1) * (spec.columns - 1)))
    length = BENDING_CELLS * cell * (max(spec.bending_n_m, 1e-4) / (weight_n_m2 * cell)) ** BENDING_POWER
    return weight_n_m2 * length**3


def young_and_thickness(spec: ClothSpec) -> tuple[float, float]:
    """Return Young's modulus, Pa, and thickness, m, of a homogeneous plate with both."""
    membrane, bending = membrane_n_m(spec), bending_n_m(spec)
    thickness = math.sqrt(12.0 * bending / membrane)
    return membrane / thickness, thickness
