"""The presets' coarse meshes drape as a fine mesh of the same springs does (docs/explanation/pybullet.md)."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from layflat.sim.cloth.spec import HELD_STRETCH, ClothSpec, cloth_spec
from layflat.sim.physics.base import TABLE_CENTRE_M, TABLE_SIZE_M
from layflat.sim.physics.bullet.world import BulletWorld
from layflat.sim.robots.pickers import FreePickers
from layflat.sim.starts.base import attach

FINE = {"towel": (21, 21), "towel-fine": (21, 21), "napkin": (21, 17)}
FINE_HZ = 800.0
PLACES = np.stack(np.meshgrid(np.linspace(0, 1, 41), np.linspace(0, 1, 41), indexing="ij"), axis=-1)


def _fine(spec: ClothSpec) -> ClothSpec:
    rows, columns = FINE[spec.name]
    damping = max(1.3 * spec.elastic_n_m / FINE_HZ / 2, 0.03)
    return replace(spec, rows=rows, columns=columns, rate_hz=FINE_HZ, damping_n_s_m=damping)


def _surface(spec: ClothSpec, situation: Literal["held", "over an edge"]) -> np.ndarray:
    """(41, 41, 3) m: the same places of the cloth, whatever its mesh."""
    world = BulletWorld(substep_s=1 / spec.rate_hz, table_friction=1.0)
    try:
        if situation == "held":
            high, half = spec.length_m + 0.12, spec.width_m / 2
            nodes = spec.hanging_nodes(np.array([[0.0, half, high], [0.0, -half, high]]))
        else:
            nodes = spec.flat_nodes(x_m=TABLE_CENTRE_M[0] + TABLE_SIZE_M[0] / 2 - 0.65 * spec.length_m, z_m=0.005)
        cloth = world.add_cloth(spec, nodes)
        world.add_air(cloth)
        if situation == "held":
            corners = nodes[list(spec.corners)] * [1.0, HELD_STRETCH, 1.0]
            attach(cloth, corners)
            FreePickers(cloth, corners).grasp()
        for _ in range(round(1.5 * spec.rate_hz)):
            world.begin_substep()
            world.step()
        grid = cloth.nodes().reshape(spec.rows, spec.columns, 3)
    finally:
        world.close()
    return RegularGridInterpolator((np.linspace(0, 1, spec.rows), np.linspace(0, 1, spec.columns)), grid)(PLACES)


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize("name", FINE)
def test_it_drapes_as_a_fine_mesh_does(name: str) -> None:
    """Held: within 2.6 mm. Over an edge, where a third hangs: 3 to 5 mm in the mean."""
    spec = cloth_spec(name)
    held, over = (
        np.linalg.norm(_surface(spec, situation) - _surface(_fine(spec), situation), axis=-1)
        for situation in ("held", "over an edge")
    )
    assert held.max() < 0.004
    assert over.mean() < 0.007
    assert over.max() < 0.015
