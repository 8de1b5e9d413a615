"""Air drag: a swing dies away, and nothing else changes."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.sim.physics.air_drag import DRAG_LIMIT_M_S2, DRAG_RATE_PER_S, AirDrag
from layflat.sim.physics.base import GRAVITY_M_S2
from layflat.sim.robots.pickers import FreePickers
from layflat.tests.sim.helpers import cloth_in_world, run, set_nodes, small_cloth

SMALL = small_cloth(0.15, 6, 6, mass_kg=0.015)


def _swing(air: bool, n_steps: int = 30) -> np.ndarray:
    """Return the centre of a cloth beside its pickers, after they moved 0.1 m and stopped, (steps * 24,) m."""
    home = np.array([[0.0, 0.075, 0.5], [0.0, -0.075, 0.5]])
    path = []
    with cloth_in_world(SMALL, SMALL.hanging_nodes(home)) as cloth:
        pickers = FreePickers(cloth, home)
        if air:
            cloth.world.add_air(cloth)
        pickers.grasp()
        for step_index in range(5 + n_steps):
            pickers.start_step(np.array([0.02 if step_index < 5 else 0.0, 0.0, 0.0] * 2), 24)
            for _ in range(24):
                cloth.world.begin_substep()
                pickers.before_substep()
                cloth.world.step()
                path.append(cloth.nodes()[:, 0].mean() - pickers.position()[0])
    return np.array(path[5 * 24 :])


def test_air_stops_a_swing() -> None:
    late = slice(-24 * 8, None)
    still, swinging = np.ptp(_swing(True)[late]), np.ptp(_swing(False)[late])
    assert swinging > 0.02
    assert still < 0.2 * swinging


def test_drag_is_rate_times_velocity_and_horizontal() -> None:
    with cloth_in_world(SMALL, SMALL.flat_nodes(z_m=2.0)) as cloth:
        world = cloth.world
        world.set_gravity((5.0, -2.0, 0.0))
        run(world, 25)
        world.set_gravity((0.0, 0.0, 0.0))
        air = AirDrag(cloth, world.set_gravity)
        while world.substeps_done < 31:
            air.update()
            world.step()
        x, y, z = world.gravity_m_s2
    assert x == pytest.approx(-DRAG_RATE_PER_S * 5.0 * 25 / 240, rel=0.02)
    assert y == pytest.approx(DRAG_RATE_PER_S * 2.0 * 25 / 240, rel=0.02)
    assert z == -GRAVITY_M_S2


def test_drag_is_bounded_and_spares_a_still_cloth() -> None:
    with cloth_in_world(SMALL, SMALL.flat_nodes()) as cloth:
        world = cloth.world
        world.add_air(cloth)
        run(world, 24)
        assert np.abs(world.gravity_m_s2[:2]).max() < 0.02
        set_nodes(cloth, SMALL.flat_nodes(x_m=0.4))  # a jump: as if at 20 m/s
        while world.substeps_done % 5:
            world.step()
        world.begin_substep()
        assert np.abs(world.gravity_m_s2[:2]).max() == pytest.approx(DRAG_LIMIT_M_S2)
