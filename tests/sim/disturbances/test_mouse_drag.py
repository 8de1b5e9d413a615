"""A person's pull by what it does to the cloth: momentum, where the node goes, and that nothing tears."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.disturbances.mouse_drag import FORCE_WEIGHTS, PICK_RADIUS_M, SPEED_M_S, MouseDrag, free_node, pick_node
from layflat.sim.errors import SimError
from layflat.sim.physics.base import GRAVITY_M_S2
from layflat.sim.physics.bullet.cloth import BulletCloth
from layflat.tests.sim.helpers import cloth_in_world, fold_corner, n_bodies, run, simulation, small_cloth

SMALL = small_cloth()
MIDDLE = 24
LIMIT_N = FORCE_WEIGHTS * SMALL.mass_kg * GRAVITY_M_S2
STEP_S = 0.1


@pytest.fixture
def cloth() -> Iterator[BulletCloth]:
    """Give a small cloth without weight, far above the table."""
    with cloth_in_world(SMALL, SMALL.flat_nodes(z_m=3.0)) as made:
        made.world.set_gravity((0.0, 0.0, 0.0))
        yield made


def run_step(cloth: BulletCloth, drag: MouseDrag, target: np.ndarray) -> None:
    drag.start_step(target, STEP_S)
    run(cloth.world, 24, drag.before_substep)


@pytest.mark.parametrize(
    ("heading", "tolerance"),
    [
        ((1.0, 0.0, 0.0), 0.05),
        ((0.6, -0.8, 0.0), 0.05),
        # As a lifted patch does (test_controller), a cloth drawn up by its middle loses a share to Bullet's damping.
        ((0.0, 0.0, 1.0), 0.12),
    ],
)
def test_momentum_is_the_logged_force_times_time(cloth: BulletCloth, heading: tuple, tolerance: float) -> None:
    drag = MouseDrag(cloth, MIDDLE)
    start = cloth.nodes()[MIDDLE]
    for _ in range(5):
        run_step(cloth, drag, start + 5.0 * np.array(heading))
    impulse = drag.impulse_n_s
    drag.release()
    before = cloth.nodes().mean(axis=0)
    cloth.world.step()
    gained = SMALL.mass_kg * (cloth.nodes().mean(axis=0) - before) / cloth.world.substep_s
    assert np.linalg.norm(impulse) > 0.005
    assert np.linalg.norm(gained - impulse) < tolerance * np.linalg.norm(impulse)


def test_the_force_is_bounded_and_the_target_followed_at_a_bounded_speed(cloth: BulletCloth) -> None:
    drag = MouseDrag(cloth, MIDDLE)
    given_n_s = np.zeros(3)
    for _ in range(4):
        before = drag.position()
        run_step(cloth, drag, np.array([40.0, 0.0, 3.0]))
        given, given_n_s = drag.impulse_n_s - given_n_s, drag.impulse_n_s
        assert np.linalg.norm(given) / STEP_S < 1.1 * LIMIT_N
        assert np.linalg.norm(drag.position() - before) < 1.2 * SPEED_M_S * STEP_S
    assert np.linalg.norm(given_n_s) > 0


def test_the_node_comes_to_its_target_and_stays(cloth: BulletCloth) -> None:
    drag = MouseDrag(cloth, MIDDLE)
    target = cloth.nodes()[MIDDLE] + [0.05, -0.03, 0.04]
    distances = []
    for _ in range(25):
        run_step(cloth, drag, target)
        distances.append(float(np.linalg.norm(cloth.nodes()[MIDDLE] - target)))
    assert max(distances[-5:]) < 0.004
    np.testing.assert_allclose(drag.position(), cloth.nodes()[MIDDLE], atol=0.003)


def test_letting_go_leaves_nothing_behind_and_there_is_no_node_49(cloth: BulletCloth) -> None:
    bodies = n_bodies(cloth.world)
    drag = MouseDrag(cloth, 0)
    run_step(cloth, drag, np.array([0.1, 0.1, 3.1]))
    assert n_bodies(cloth.world) == bodies + 1
    drag.release()
    assert n_bodies(cloth.world) == bodies
    for node in (-1, 49):
        with pytest.raises(SimError, match="0 to 48"):
            MouseDrag(cloth, node)


@pytest.mark.parametrize(("robot", "cloth_name"), [("hanger", "napkin"), ("pickers", "towel")])
@pytest.mark.parametrize("where", ["anywhere", "corner", "under"])
def test_flinging_the_mouse_tears_nothing(robot: str, cloth_name: str, where: str) -> None:
    """Ten steps of targets metres away, in all directions or under the table, then a release in the air."""
    rng = np.random.default_rng(2)
    with simulation(robot, cloth=cloth_name) as sim:
        spec, rest = sim.config.cloth_spec, sim.spec.robot.zeros()
        node = spec.corners[0] if where == "corner" else int(rng.integers(spec.n_nodes))
        for _ in range(10):
            sim.drag(node, np.array([0.2, 0.1, -0.5]) if where == "under" else rng.uniform([-2, -2, -1], [2, 2, 2]))
            sim.step(rest)
            assert sim.divergence_reason() is None
            assert sim.drag_target is not None
            assert sim.drag_target.node == node
            assert 0 < np.linalg.norm(sim.force_n()) < 1.15 * FORCE_WEIGHTS * spec.mass_kg * GRAVITY_M_S2
        sim.release()
        assert sim.drag_target is None
        for _ in range(4):
            sim.step(rest)
            assert sim.divergence_reason() is None
            assert not sim.force_n().any()


def test_another_node_is_another_hand_and_forces_add_up() -> None:
    with simulation() as sim:
        bodies = n_bodies(sim.world)
        place = sim.ground_truth().nodes[60]
        sim.drag(30, place)
        sim.drag(60, place + np.array([0.1, 0.0, 0.0]))
        assert n_bodies(sim.world) == bodies + 1
        sim.step(np.zeros(6))
        assert sim.force_n()[0] > 0.001
        record, drag = sim.disturb("wind"), sim._drag
        assert record is not None
        assert drag is not None
        before = drag.impulse_n_s
        sim.step(np.zeros(6))
        dragged = (drag.impulse_n_s - before) / sim.spec.step_s
        wind = sim.config.cloth_spec.mass_kg * np.array(record.plan["wind_m_s2"])
        assert wind[1] > 0.05
        np.testing.assert_allclose(sim.force_n(), dragged + wind, atol=1e-9)


def test_targets_that_are_none_are_refused() -> None:
    with simulation(seed=None) as sim:
        with pytest.raises(SimError, match="reset"):
            sim.drag(0, np.zeros(3))
        sim.reset(0)
        for wrong in ([np.nan, 0.0, 0.0], [1.0, 2.0]):
            with pytest.raises(SimError, match=r"finite numbers of shape \(3,\)"):
                sim.drag(0, np.array(wrong))
        sim.release()


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
