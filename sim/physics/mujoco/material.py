"""What a cloth's springs mean as a sheet: membrane and bending stiffness.

Both engines simulate the fabric that a `ClothSpec` describes. Its springs are those of Bullet; here they become the
constants of a sheet that hangs and droops alike (see docs/explanation/results/engines.md for how well).
"""

from __future__ import annotations

import math

from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.physics.base import GRAVITY_M_S2

MEMBRANE = 1.8
"""Membrane stiffness, N/m / stiffness of a spring, N/m: two diagonals help the springs along a thread."""
BENDING_LENGTH_M = 0.0135


def membrane_n_m(spec: ClothSpec) -> float:
    """Return Young's modulus * thickness."""
    return MEMBRANE * spec.elastic_n_m


def bending_n_m(spec: ClothSpec) -> float:
    """Return the bending stiffness, N m: weight of an area * bending length cubed (Peirce 1930)."""
    weight_n_m2 = spec.mass_kg * GRAVITY_M_S2 / (spec.length_m * spec.width_m)
    return weight_n_m2 * BENDING_LENGTH_M**3


def young_and_thickness(spec: ClothSpec) -> tuple[float, float]:
    """Return Young's modulus, Pa, and thickness, m, of a homogeneous plate with both."""
    membrane, bending = membrane_n_m(spec), bending_n_m(spec)
    thickness = math.sqrt(12.0 * bending / membrane)
    return membrane / thickness, thickness
