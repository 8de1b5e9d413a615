"""A person's pull by what it does to the cloth: momentum, where the node goes, and that nothing tears."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator

import numpy as np
import pybullet as bullet
import pytest
from hypothesis import given
from hypothesis import strategies as st

from layflat.sim.cloth.spec import ClothSpec, cloth_spec
from layflat.sim.config import SimConfig
from layflat.sim.disturbances.mouse_drag import FORCE_WEIGHTS, PICK_RADIUS_M, SPEED_M_S, MouseDrag, free_node, pick_node
from layflat.sim.errors import SimError
from layflat.sim.physics.base import GRAVITY_M_S2
from layflat.sim.physics.bullet.cloth import BulletCloth
from layflat.sim.physics.bullet.world import BulletWorld
from layflat.sim.robots.registry import robot_spec
from layflat.sim.simulation import ClothSimulation
from layflat.tests.sim.drawn_fold import fold_corner

SMALL = ClothSpec(
    name="small", length_m=0.2, width_m=0.2, rows=7, columns=7,
    mass_kg=0.02, elastic_n_m=40.0, damping_n_s_m=0.12, bending_n_m=0.1,
)  # fmt: skip
MIDDLE = 24
LIMIT_N = FORCE_WEIGHTS * SMALL.mass_kg * GRAVITY_M_S2
STEP_S = 0.1
STEP_STEPS = 24


@pytest.fixture
def flying() -> Iterator[tuple[BulletWorld, BulletCloth]]:
    """A small cloth without weight, far above the table."""
    world = BulletWorld(substep_s=1 / SMALL.rate_hz, table_friction=1.0)
    cloth = world.add_cloth(SMALL)
    cloth.set_nodes(SMALL.flat_nodes(z_m=3.0))
    world.set_gravity((0.0, 0.0, 0.0))
    yield world, cloth
    world.close()


def run_step(world: BulletWorld, pull: MouseDrag, target: np.ndarray) -> None:
    pull.start_step(target, STEP_S)
    for _ in range(STEP_STEPS):
        pull.before_substep()
        world.step()


@pytest.mark.parametrize(
    ("heading", "tolerance"),
    [
        ((1.0, 0.0, 0.0), 0.05),
        ((0.6, -0.8, 0.0), 0.05),
        # Drawn up by its middle a cloth drapes around the hand, and Bullet's damping takes a share of that momentum, as
        # it does of a lifted patch's (test_disturbance).
        ((0.0, 0.0, 1.0), 0.12),
    ],
)
def test_momentum_is_the_logged_force_times_time(
    flying: tuple[BulletWorld, BulletCloth], heading: tuple[float, ...], tolerance: float
) -> None:
    world, cloth = flying
    pull = MouseDrag(cloth, MIDDLE)
    start = cloth.nodes()[MIDDLE]
    for _ in range(5):
        run_step(world, pull, start + 5.0 * np.array(heading))
    impulse = pull.impulse_n_s
    pull.release()
    before = cloth.nodes().mean(axis=0)
    world.step()
    gained = SMALL.mass_kg * (cloth.nodes().mean(axis=0) - before) / world.substep_s
    assert np.linalg.norm(impulse) > 0.005
    assert np.linalg.norm(gained - impulse) < tolerance * np.linalg.norm(impulse)


def test_the_force_is_bounded_and_the_target_followed_at_a_bounded_speed(
    flying: tuple[BulletWorld, BulletCloth],
) -> None:
    world, cloth = flying
    pull = MouseDrag(cloth, MIDDLE)
    given_n_s = np.zeros(3)
    for _ in range(4):
        before = pull.position()
        run_step(world, pull, np.array([40.0, 0.0, 3.0]))
        given, given_n_s = pull.impulse_n_s - given_n_s, pull.impulse_n_s
        assert np.linalg.norm(given) / STEP_S < 1.1 * LIMIT_N
        assert np.linalg.norm(pull.position() - before) < 1.2 * SPEED_M_S * STEP_S
    assert np.linalg.norm(given_n_s) > 0


def test_the_node_comes_to_its_target_and_stays(flying: tuple[BulletWorld, BulletCloth]) -> None:
    world, cloth = flying
    pull = MouseDrag(cloth, MIDDLE)
    target = cloth.nodes()[MIDDLE] + [0.05, -0.03, 0.04]
    distances = []
    for _ in range(25):
        run_step(world, pull, target)
        distances.append(float(np.linalg.norm(cloth.nodes()[MIDDLE] - target)))
    assert max(distances[-5:]) < 0.004
    np.testing.assert_allclose(pull.position(), cloth.nodes()[MIDDLE], atol=0.003)


def test_letting_go_leaves_nothing_behind(flying: tuple[BulletWorld, BulletCloth]) -> None:
    world, cloth = flying
    bodies = bullet.getNumBodies(physicsClientId=world.client)
    pull = MouseDrag(cloth, 0)
    run_step(world, pull, np.array([0.1, 0.1, 3.1]))
    assert bullet.getNumBodies(physicsClientId=world.client) == bodies + 1
    pull.release()
    assert bullet.getNumBodies(physicsClientId=world.client) == bodies


def test_a_node_that_is_none_is_refused(flying: tuple[BulletWorld, BulletCloth]) -> None:
    for node in (-1, 49):
        with pytest.raises(SimError, match="0 to 48"):
            MouseDrag(flying[1], node)


class TestOnTheBench:
    @pytest.mark.parametrize(("robot", "cloth"), [("hanger", "napkin"), ("pickers", "towel")])
    @pytest.mark.parametrize("where", ["anywhere", "corner", "under"])
    def test_flinging_the_mouse_tears_nothing(self, robot: str, cloth: str, where: str) -> None:
        """Ten steps of targets metres away, in all directions or under the table, then let go in the air."""
        bench = ClothSimulation(SimConfig(robot=robot, cloth=cloth, camera=False))  # type: ignore[arg-type]
        spec, rest = bench.config.cloth_spec, np.zeros(robot_spec(bench.config.robot).size)
        rng = np.random.default_rng(2)
        try:
            bench.reset(0)
            node = spec.corners[0] if where == "corner" else int(rng.integers(spec.rows * spec.columns))
            for _ in range(10):
                target = np.array([0.2, 0.1, -0.5]) if where == "under" else rng.uniform([-2, -2, -1], [2, 2, 2])
                bench.drag(node, target)
                bench.step(rest)
                assert bench.divergence_reason() is None
                assert bench.drag_target.node == node
                limit = FORCE_WEIGHTS * spec.mass_kg * GRAVITY_M_S2
                assert 0 < np.linalg.norm(bench.force_n()) < 1.15 * limit
            bench.release()
            assert bench.drag_target is None
            for _ in range(4):
                bench.step(rest)
                assert bench.divergence_reason() is None
                assert not bench.force_n().any()
        finally:
            bench.close()

    def test_another_node_is_another_hand_and_a_disturbance_adds_up(self) -> None:
        bench = ClothSimulation(SimConfig(robot="pickers", cloth="napkin", camera=False))
        try:
            bench.reset(0)
            bodies = bullet.getNumBodies(physicsClientId=bench.world.client)
            place = bench.ground_truth().nodes[60]
            bench.drag(30, place)
            bench.drag(60, place + np.array([0.1, 0.0, 0.0]))
            assert bullet.getNumBodies(physicsClientId=bench.world.client) == bodies + 1
            bench.step(np.zeros(6))
            alone = bench.force_n()
            assert alone[0] > 0.001
            assert bench._drag is not None
            record = bench.disturb("wind")
            before = bench._drag.impulse_n_s
            bench.step(np.zeros(6))
            pulled = (bench._drag.impulse_n_s - before) / bench.config.step_s
            wind = bench.config.cloth_spec.mass_kg * np.array(record.plan["wind_m_s2"])
            assert wind[1] > 0.05
            np.testing.assert_allclose(bench.force_n(), pulled + wind, atol=1e-9)
        finally:
            bench.close()

    def test_what_is_no_place_is_refused(self) -> None:
        bench = ClothSimulation(SimConfig(robot="pickers", cloth="napkin", camera=False))
        with pytest.raises(SimError, match="reset"):
            bench.drag(0, np.zeros(3))
        bench.reset(0)
        try:
            for wrong in ([np.nan, 0.0, 0.0], [1.0, 2.0]):
                with pytest.raises(SimError, match="three finite numbers"):
                    bench.drag(0, np.array(wrong))
            bench.release()
        finally:
            bench.close()


_SCRIPT = """
import hashlib, sys, numpy as np
from layflat.sim.simulation import ClothSimulation
from layflat.sim.config import SimConfig
bench = ClothSimulation(SimConfig(robot="hanger", cloth="napkin", camera=False, start="folded-corner"))
bench.reset(3)
rng = np.random.default_rng(int(sys.argv[1]))
for k in range(12):
    if k < 9:
        bench.drag(int(sys.argv[2]), rng.uniform([0, -0.2, 0], [0.3, 0.2, 0.1]))
    else:
        bench.release()
    bench.step(np.array([0.002, 0.0]))
print(hashlib.sha256(bench.ground_truth().nodes.tobytes() + bench.force_n().tobytes()).hexdigest())
"""


def test_the_same_pulls_in_fresh_processes_give_the_same_bits() -> None:
    runs = [
        subprocess.Popen([sys.executable, "-c", _SCRIPT, *seed_node], stdout=subprocess.PIPE, text=True)
        for seed_node in (("1", "40"), ("1", "40"), ("2", "40"))
    ]
    first, second, other = (run.communicate(timeout=100)[0].split()[-1] for run in runs)
    assert first == second != other


@given(node=st.integers(0, 168), x=st.floats(-0.5, 1.0), y=st.floats(-0.6, 0.6), z=st.floats(0.2, 1.5))
def test_a_ray_at_a_node_picks_it(node: int, x: float, y: float, z: float) -> None:
    spec = cloth_spec("towel")
    nodes = spec.flat_nodes()
    eye = np.array([x, y, z])
    assert pick_node(nodes, spec.triangles(), eye, 0.37 * (nodes[node] - eye)) == node


def test_the_layer_in_front_is_picked() -> None:
    spec = cloth_spec("towel")
    nodes = fold_corner(spec.flat_nodes(), spec, (0.2, 0.2), left=True)
    for node in (0, 1, spec.columns):
        above = nodes[node] + [0.0, 0.0, 0.5]
        assert pick_node(nodes, spec.triangles(), above, np.array([0.0, 0.0, -1.0])) == node
        below = nodes[node] - [0.0, 0.0, 0.5]
        under = pick_node(nodes, spec.triangles(), below, np.array([0.0, 0.0, 1.0]))
        assert under is not None
        assert nodes[under, 2] < nodes[node, 2] - 0.004


def test_beside_the_cloth_a_ray_picks_the_nearest_within_its_radius() -> None:
    spec = cloth_spec("towel")
    nodes, down = spec.flat_nodes(), np.array([0.0, 0.0, -1.0])
    corner = nodes[0]
    near, far = (corner + np.array([0.0, share * PICK_RADIUS_M, 1.0]) for share in (0.9, 1.1))
    assert pick_node(nodes, spec.triangles(), near, down) == 0
    assert pick_node(nodes, spec.triangles(), far, down) is None
    assert pick_node(nodes, spec.triangles(), near, -down) is None
    for wrong in (np.zeros(3), np.array([np.nan, 0.0, 1.0])):
        with pytest.raises(SimError, match="ray"):
            pick_node(nodes, spec.triangles(), near, wrong)


def test_beside_a_held_corner_lies_a_free_node() -> None:
    for name in ("towel", "napkin"):
        spec = cloth_spec(name)
        nodes = spec.flat_nodes()
        cell = np.hypot(spec.length_m / (spec.rows - 1), spec.width_m / (spec.columns - 1))
        for corner in spec.corners:
            beside = free_node(spec, corner)
            assert beside not in spec.corners
            assert np.linalg.norm(nodes[beside] - nodes[corner]) == pytest.approx(cell)
        assert free_node(spec, 5) == 5
