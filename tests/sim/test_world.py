"""The world: what it refuses, and the facts of Bullet that shape it."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest

from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.errors import SimError
from layflat.sim.physics.base import GRAVITY_M_S2, TABLE_CENTRE_M, TABLE_SIZE_M
from layflat.sim.physics.bullet.world import BulletWorld


def _small(rows: int, columns: int) -> ClothSpec:
    return ClothSpec(
        name=f"small {rows}x{columns}", length_m=0.03 * (rows - 1), width_m=0.03 * (columns - 1), rows=rows,
        columns=columns, mass_kg=0.0004 * rows * columns, elastic_n_m=40.0, damping_n_s_m=0.12, bending_n_m=0.1,
    )  # fmt: skip


def _world(**changes: float) -> BulletWorld:
    return BulletWorld(**({"substep_s": 1 / 240, "table_friction": 1.0} | changes))


@pytest.mark.parametrize(
    "wrong",
    [
        {"substep_s": 0.0},
        {"substep_s": 0.02},
        {"substep_s": math.nan},
        {"table_friction": -1.0},
        {"table_friction": 9.0},
    ],
)
def test_impossible_worlds_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(SimError, match="must be"):
        _world(**wrong)


def test_gravity_must_be_finite() -> None:
    world = _world()
    with pytest.raises(SimError, match="finite"):
        world.set_gravity((0.0, 0.0, math.nan))
    world.close()


def test_time_is_substeps_and_close_can_be_repeated() -> None:
    world = _world()
    for _ in range(24):
        world.step()
    assert world.time_s == pytest.approx(0.1)
    world.close()
    world.close()


def test_the_table_is_a_box_with_its_top_at_zero_and_its_edges_where_they_should_be() -> None:
    """On a plane (undefined behaviour for cloth: faces are tested against convex shapes) the outer one would stop."""
    right = TABLE_CENTRE_M[0] + TABLE_SIZE_M[0] / 2
    spec = _small(4, 4)
    for x_m, rests in ((right - 0.1 - spec.length_m, True), (right + 0.1, False)):
        world = _world()
        cloth = world.add_cloth(spec)
        cloth.set_nodes(spec.flat_nodes(x_m=x_m, z_m=0.006))
        for _ in range(72):
            world.step()
        heights = cloth.nodes()[:, 2]
        if rests:
            assert heights.min() > 0.0
        else:
            assert 0.006 - heights.mean() == pytest.approx(0.5 * GRAVITY_M_S2 * 0.3**2, rel=0.03)
        world.close()


def test_friction_of_the_table_holds_or_lets_slide() -> None:
    """Sideways gravity of 0.3 g: below the friction of 0.5 * 1, above that of 0.5 * 0.2."""
    moved = []
    for friction in (1.0, 0.2):
        world, spec = _world(table_friction=friction), _small(4, 4)
        cloth = world.add_cloth(spec)
        cloth.set_nodes(spec.flat_nodes())
        for _ in range(24):
            world.step()
        before = cloth.nodes()[:, 0].mean()
        world.set_gravity((0.3 * GRAVITY_M_S2, 0.0, -GRAVITY_M_S2))
        for _ in range(96):
            world.step()
        moved.append(cloth.nodes()[:, 0].mean() - before)
        world.close()
    free = 0.5 * (0.3 - 0.5 * 0.2) * GRAVITY_M_S2 * 0.4**2
    assert abs(moved[0]) < 0.003
    assert moved[1] == pytest.approx(free, rel=0.25)


def test_each_cloth_of_a_process_has_its_own_mesh() -> None:
    """Bullet caches OBJ files by path: an older cloth's mesh would come back."""
    for rows, columns in ((3, 5), (4, 4), (3, 5)):
        world, spec = _world(), _small(rows, columns)
        cloth = world.add_cloth(spec)
        np.testing.assert_allclose(cloth.nodes(), spec.flat_nodes(z_m=0.5), atol=1e-6)
        world.close()


def test_two_worlds_do_not_meet() -> None:
    first, second = _world(), _world()
    spec = _small(3, 3)
    cloth = first.add_cloth(spec)
    other = second.add_cloth(spec)
    before = other.nodes()
    for _ in range(12):
        first.step()
    assert cloth.nodes()[:, 2].max() < before[:, 2].min()
    np.testing.assert_array_equal(other.nodes(), before)
    first.close()
    second.close()


@pytest.mark.parametrize(
    "call",
    [
        "import layflat.sim.physics.bullet.world",
        "import layflat.sim.simulation",
        "import layflat.sim.physics.bullet; import pybullet",
    ],
)
def test_imports_print_nothing(call: str) -> None:
    """PyBullet prints the time of its build."""
    done = subprocess.run([sys.executable, "-c", call], capture_output=True, check=True, timeout=60)
    assert done.stdout == b""
    assert done.stderr == b""


def test_output_after_the_quiet_import_is_heard() -> None:
    call = "import sys, layflat.sim.physics.bullet; print('out'); print('err', file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", call], capture_output=True, check=True, timeout=60)
    assert (done.stdout.split(), done.stderr.split()) == ([b"out"], [b"err"])
