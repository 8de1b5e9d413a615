"""Cloth that lies on the table in wrinkles of one direction, to measure wrinkle descriptors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.errors import SimError
from layflat.sim.physics.registry import make_world

CENTRE_M = (0.20, 0.0)
"""Middle of the cloth."""
SETTLE_S = 0.3


@dataclass(frozen=True, kw_only=True)
class Wrinkling:
    """A sine: height = amplitude (1 - cos(2 pi across / wavelength + phase)) above the table."""

    normal_rad: float
    """Angle of the wrinkles' perpendicular from +x, table coordinates."""
    wavelength_m: float
    """Wavelength on the table. A mesh shows wrinkles of 2.5 of its cells and longer."""
    amplitude_m: float
    phase_rad: float = 0.0

    def __post_init__(self) -> None:
        if not (self.wavelength_m > 0 and 0 <= self.amplitude_m < self.wavelength_m / 4):
            raise SimError(
                f"wrinkles of amplitude {self.amplitude_m} m and wavelength {self.wavelength_m} m: the amplitude must "
                "be between 0 and a quarter of the wavelength"
            )

    @classmethod
    def random(cls, rng: np.random.Generator, spec: ClothSpec, normal_rad: float) -> Wrinkling:
        """Draw a wavelength of 2.5 to 3.1 cells, an amplitude of 8.5 to 12.5 % of it, and any phase."""
        cell_m = max(spec.length_m / (spec.rows - 1), spec.width_m / (spec.columns - 1))
        wavelength_m = float(rng.uniform(2.5, 3.1)) * cell_m
        return cls(
            normal_rad=normal_rad,
            wavelength_m=wavelength_m,
            amplitude_m=float(rng.uniform(0.085, 0.125)) * wavelength_m,
            phase_rad=float(rng.uniform(0.0, 2 * math.pi)),
        )


def wrinkled_nodes(spec: ClothSpec, wrinkling: Wrinkling) -> FloatArray:
    """Return nodes (N, 3) m of a cloth about CENTRE_M, drawn together across the wrinkles so that its length is kept.

    Its lowest points are at rest height.
    """
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


def settled_wrinkles(
    spec: ClothSpec, wrinkling: Wrinkling, *, settle_s: float = SETTLE_S, table_friction: float = 1.0
) -> FloatArray:
    """Return the nodes (N, 3) m that the physics makes of `wrinkled_nodes`; SimError if the cloth diverges.

    Nodes that are set are the shape at rest: the wrinkles stay, eased by gravity and the table.
    """
    world = make_world(substep_s=1.0 / spec.rate_hz, table_friction=table_friction)
    try:
        cloth = world.add_cloth(spec)
        cloth.set_nodes(wrinkled_nodes(spec, wrinkling))
        for _ in range(round(settle_s * spec.rate_hz)):
            world.step()
        nodes = cloth.nodes()
        reason = cloth.divergence_reason(nodes)
        if reason is not None:
            raise SimError(f"the wrinkled cloth diverged: {reason}")
        return nodes
    finally:
        world.close()
