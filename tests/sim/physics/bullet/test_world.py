"""The world: what it refuses, and the facts of Bullet that shape it."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest

from layflat.sim.errors import SimError
from layflat.sim.physics.base import GRAVITY_M_S2, TABLE_CENTRE_M, TABLE_SIZE_M, TICKS
from layflat.sim.physics.bullet.world import BulletWorld
from layflat.sim.physics.registry import PHYSICS, make_world
from layflat.tests.sim.helpers import bullet_world, cloth_in_world, run, small_cloth

SMALL = small_cloth(0.09, 4, 4, mass_kg=0.0064)


@pytest.mark.parametrize(
    "wrong", [{"substep_s": 0.0}, {"substep_s": 0.02}, {"substep_s": math.nan}, {"table_friction": -1.0},
              {"table_friction": 9.0}],
)  # fmt: skip
def test_impossible_worlds_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(SimError, match="must be"):
        BulletWorld(**({"substep_s": 1 / 240, "table_friction": 1.0} | wrong))
    with pytest.raises(SimError, match=next(iter(PHYSICS))):
        make_world("clay", substep_s=1 / 240)


def test_wind_adds_to_gravity_until_it_ends() -> None:
    with bullet_world() as world:
        with pytest.raises(SimError, match="finite"):
            world.set_gravity((0.0, 0.0, math.nan))
        world.set_wind((2.0, 0.0, 0.0))
        world.set_gravity((0.0, 1.0, -9.0))
        assert world.gravity_m_s2 == (2.0, 1.0, -9.0)
        world.set_wind(None)
        assert world.gravity_m_s2 == (0.0, 1.0, -9.0)


def test_time_is_substeps_and_close_can_be_repeated() -> None:
    with bullet_world(200) as world:
        for parts, steps in ((1, 3), (2, 4), (1, 1), (4, 4)):
            world.refine(parts)
            assert world.substep_s == 1 / 200 / parts
            run(world, steps)
        assert world.time_s == 7 / 200
        assert world.ticks(0.02) == 4 * TICKS
        assert world.seconds(4 * TICKS) == 0.02
        with pytest.raises(SimError, match="3 parts"):
            world.refine(3)
        world.close()


@pytest.mark.parametrize("over", [False, True])
def test_the_table_has_its_top_at_zero_and_ends_at_its_edge(over: bool) -> None:
    """On a plane (undefined behaviour for cloth: faces are tested against convex shapes) the outer one would stop."""
    x_m = TABLE_CENTRE_M[0] + TABLE_SIZE_M[0] / 2 + (0.1 if over else -0.1 - SMALL.length_m)
    with cloth_in_world(SMALL, SMALL.flat_nodes(x_m=x_m, z_m=0.006)) as cloth:
        run(cloth.world, 72)
        heights = cloth.nodes()[:, 2]
    if over:
        assert 0.006 - heights.mean() == pytest.approx(0.5 * GRAVITY_M_S2 * 0.3**2, rel=0.03)
    else:
        assert heights.min() > 0.0


def test_friction_of_the_table_holds_or_lets_slide() -> None:
    """Sideways gravity of 0.3 g: below the friction of 0.5 * 1, above that of 0.5 * 0.2."""
    moved = []
    for friction in (1.0, 0.2):
        with cloth_in_world(SMALL, SMALL.flat_nodes(), table_friction=friction) as cloth:
            run(cloth.world, 24)
            before = cloth.nodes()[:, 0].mean()
            cloth.world.set_gravity((0.3 * GRAVITY_M_S2, 0.0, -GRAVITY_M_S2))
            run(cloth.world, 96)
            moved.append(cloth.nodes()[:, 0].mean() - before)
    assert abs(moved[0]) < 0.003
    assert moved[1] == pytest.approx(0.5 * (0.3 - 0.5 * 0.2) * GRAVITY_M_S2 * 0.4**2, rel=0.25)


def test_each_cloth_of_a_process_has_its_own_mesh() -> None:
    """Bullet caches OBJ files by path: an older cloth's mesh would come back."""
    for rows, columns in ((3, 5), (4, 4), (3, 5)):
        spec = small_cloth(0.09, rows, columns)
        with cloth_in_world(spec) as cloth:
            np.testing.assert_allclose(cloth.nodes(), spec.flat_nodes(z_m=0.5), atol=1e-6)


@pytest.mark.parametrize(
    "call", ["import layflat.sim.physics.bullet.world", "import layflat.sim.physics.bullet, pybullet"]
)
def test_imports_print_nothing_and_later_output_is_kept(call: str) -> None:
    """PyBullet prints the time of its build."""
    call += "; import sys; print('out'); print('err', file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", call], capture_output=True, check=True, timeout=60)
    assert (done.stdout.split(), done.stderr.split()) == ([b"out"], [b"err"])
