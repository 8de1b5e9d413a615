"""Air drag: a swing dies away, and nothing else changes."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.physics.base import GRAVITY_M_S2
from layflat.sim.physics.bullet.air_drag import DRAG_LIMIT_M_S2, DRAG_RATE_PER_S, AirDrag
from layflat.sim.physics.bullet.world import BulletWorld
from layflat.sim.robots.pickers import FreePickers

SMALL = ClothSpec(
    name="small", length_m=0.15, width_m=0.15, rows=6, columns=6,
    mass_kg=0.015, elastic_n_m=40.0, damping_n_s_m=0.12, bending_n_m=0.1,
)  # fmt: skip


def _swing(air: bool, n_steps: int = 30) -> np.ndarray:
    """Centre of a cloth beside its pickers, after they moved 0.1 m and stopped, (steps * 24,) m."""
    world = BulletWorld(substep_s=1 / SMALL.rate_hz, table_friction=1.0)
    cloth = world.add_cloth(SMALL)
    home = np.array([[0.0, 0.075, 0.5], [0.0, -0.075, 0.5]])
    cloth.set_nodes(SMALL.hanging_nodes(home))
    pickers = FreePickers(cloth, home)
    if air:
        world.add_air(cloth)
    pickers.grasp()
    path = []
    for step_index in range(5 + n_steps):
        pickers.start_step(np.array([0.02 if step_index < 5 else 0.0, 0.0, 0.0] * 2), 24)
        for _ in range(24):
            world.begin_substep()
            pickers.before_substep()
            world.step()
            path.append(cloth.nodes()[:, 0].mean() - pickers.position()[0])
    world.close()
    return np.array(path[5 * 24 :])


def test_air_stops_a_swing() -> None:
    late = slice(-24 * 8, None)
    still, swinging = np.ptp(_swing(True)[late]), np.ptp(_swing(False)[late])
    assert swinging > 0.02
    assert still < 0.2 * swinging


def test_drag_is_rate_times_velocity_and_horizontal() -> None:
    world = BulletWorld(substep_s=1 / SMALL.rate_hz, table_friction=1.0)
    cloth = world.add_cloth(SMALL)
    cloth.set_nodes(SMALL.flat_nodes(z_m=2.0))
    world.set_gravity((5.0, -2.0, 0.0))
    for _ in range(25):  # 25 substeps: about 0.5 m/s along x and -0.2 m/s along y
        world.step()
    world.set_gravity((0.0, 0.0, 0.0))
    air = AirDrag(cloth, world.set_gravity)
    while world.substeps_done < 31:
        air.update()
        world.step()
    x, y, z = world.gravity_m_s2
    assert x == pytest.approx(-DRAG_RATE_PER_S * 5.0 * 25 / 240, rel=0.02)
    assert y == pytest.approx(DRAG_RATE_PER_S * 2.0 * 25 / 240, rel=0.02)
    assert z == -GRAVITY_M_S2
    world.close()


def test_drag_is_bounded_and_spares_a_still_cloth() -> None:
    world = BulletWorld(substep_s=1 / SMALL.rate_hz, table_friction=1.0)
    cloth = world.add_cloth(SMALL)
    cloth.set_nodes(SMALL.flat_nodes())
    world.add_air(cloth)
    for _ in range(24):
        world.begin_substep()
        world.step()
    assert np.abs(world.gravity_m_s2[:2]).max() < 0.02
    cloth.set_nodes(SMALL.flat_nodes(x_m=0.4))  # a jump: as if at 20 m/s
    while world.substeps_done % 5:
        world.step()
    world.begin_substep()
    assert np.abs(world.gravity_m_s2[:2]).max() == pytest.approx(DRAG_LIMIT_M_S2)
    world.close()
