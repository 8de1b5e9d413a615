"""The Panda with its hanger: start, impedance, set point, and the cloth that it carries."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.errors import SimError
from layflat.sim.physics.base import GRAVITY_M_S2
from layflat.sim.physics.bullet.world import BulletWorld
from layflat.sim.robots import panda
from layflat.sim.robots.hanger import MAX_LEAD_M, PandaHanger
from layflat.tests.sim.helpers import bullet_world, run, set_nodes
from layflat.tests.sim.robots.hangers import AXES, START, bare_hanger, run_step, watched

RATES_HZ = (200, 240, 300)


@pytest.mark.parametrize("cloth", ["towel", "napkin"])
@pytest.mark.parametrize("start", [START, (-0.1, 0.55), (0.6, 0.004), (0.3, 0.2)])
def test_clips_are_at_the_corners(world: BulletWorld, cloth: str, start: tuple[float, float]) -> None:
    hanger = bare_hanger(world, start, cloth)
    wanted = cloth_spec(cloth).corners_at(*start)
    np.testing.assert_allclose(hanger.corner_positions(), wanted, atol=1e-4)
    np.testing.assert_allclose(hanger.position(), wanted.mean(axis=0), atol=1e-4)


def test_corners_that_do_not_fit_and_other_nonsense_are_refused(world: BulletWorld) -> None:
    spec = cloth_spec("towel")
    holder = SimpleNamespace(world=world, spec=spec)
    good = spec.corners_at(*START)
    for bad in (good[::-1], good * [1, 0.9, 1], np.add(good, [[0, 0, 0.01], [0, 0, 0]])):
        with pytest.raises(SimError, match="do not fit"):
            PandaHanger(holder, bad)  # type: ignore[arg-type]
    for away in ([0.7, 0, 0], [0, 0, 0.3], [0, 0.1, 0]):
        with pytest.raises(SimError, match="cannot start"):
            PandaHanger(holder, good + away)  # type: ignore[arg-type]
    with pytest.raises(SimError, match="control"):
        PandaHanger(holder, good, control="magic")  # type: ignore[arg-type]
    for action in (np.array([np.nan, 0.0]), np.zeros(6)):
        with pytest.raises(SimError, match="two finite numbers"):
            bare_hanger(world).start_step(action, 24)


@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_holds_still(rate_hz: float) -> None:
    with bullet_world(rate_hz) as world:
        hanger = bare_hanger(world)
        start = hanger.position()
        for _ in range(50):
            torques = run_step(world, hanger)
            assert np.abs(hanger.position() - start).max() < 1e-5
            assert (torques < panda.TORQUE_LIMIT_N_M).all()


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("start", [START, (0.35, 0.02)])
def test_stiffness_is_400_n_per_m(world: BulletWorld, axis: int, start: tuple[float, float]) -> None:
    hanger = bare_hanger(world, start)
    push = np.zeros(3)
    push[axis] = 4.0
    before = hanger.position()
    for _ in range(20):
        run_step(world, hanger, push_n=tuple(push))
    np.testing.assert_allclose(hanger.position() - before, push / 400.0, atol=2e-4)


def test_critically_damped(world: BulletWorld) -> None:
    """Let go of a push, it comes back without passing the set point by more than a hair."""
    hanger = bare_hanger(world)
    start = hanger.position()[0]
    for _ in range(20):
        run_step(world, hanger, push_n=(4.0, 0.0, 0.0))
    path: list[float] = []
    run(world, 240, hanger.before_substep, lambda: path.append(hanger.position()[0] - start))
    assert min(path) > -0.0005
    assert abs(path[-1]) < 0.0002
    # Not sluggish either: half the way within a quarter of a second.
    assert path[60] < 0.005


@pytest.mark.parametrize("action", [(0.01, 0.0), (0.0, -0.01), (0.007, -0.007)])
def test_follows_ten_millimetres_a_step(world: BulletWorld, action: tuple[float, float]) -> None:
    hanger = bare_hanger(world)
    for step_index in range(30):
        torques = run_step(world, hanger, action)
        lag = np.linalg.norm(hanger.position() - hanger.set_point)
        assert lag < (0.004 if step_index < 5 else 0.0015)
        left, right = hanger.corner_positions()
        assert abs(left[2] - right[2]) < 0.001
        assert abs(left[0] - right[0]) < 0.001
        assert (torques < panda.TORQUE_LIMIT_N_M).all()
    for _ in range(10):
        run_step(world, hanger)
    np.testing.assert_allclose(hanger.position()[AXES], np.add(START, np.multiply(30, action)), atol=2e-4)


@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_shaking_with_the_largest_actions_stays_stable(rate_hz: float) -> None:
    with bullet_world(rate_hz) as world:
        hanger = bare_hanger(world, (0.25, 0.3))
        rng = np.random.default_rng(1)
        for _ in range(40):
            torques = run_step(world, hanger, tuple(rng.uniform(-0.02, 0.02, 2)))
            assert (torques < panda.TORQUE_LIMIT_N_M).all()
            assert np.linalg.norm(hanger.position() - hanger.set_point) < MAX_LEAD_M
        for _ in range(15):
            run_step(world, hanger)
        assert np.linalg.norm(hanger.position() - hanger.set_point) < 1e-3


def test_torques_never_pass_the_limits(world: BulletWorld) -> None:
    hanger = bare_hanger(world)
    largest = np.zeros(panda.JOINTS)
    for _ in range(5):
        largest = np.maximum(largest, run_step(world, hanger, push_n=(150.0, 0.0, -150.0)))
    assert (largest <= panda.TORQUE_LIMIT_N_M).all()
    assert (largest == panda.TORQUE_LIMIT_N_M).any()
    assert np.isfinite(hanger.position()).all()


def test_sideways_gravity_is_compensated(world: BulletWorld) -> None:
    """Wind on the cloth is made from gravity; it must not blow the arm away."""
    hanger = bare_hanger(world)
    start = hanger.position()
    world.set_gravity((1.5, -1.0, -GRAVITY_M_S2))
    for _ in range(10):
        run_step(world, hanger)
    assert np.abs(hanger.position() - start).max() < 0.001


@pytest.mark.parametrize(
    ("start", "actions", "end"),
    [(START, [(0.01, -0.005)] * 10 + [(-0.01, 0.005)] * 10, START), ((0.58, 0.02), [(0.02, -0.02)] * 5, (0.60, 0.004))],
)
def test_actions_add_up_without_drift_within_the_workspace(
    world: BulletWorld, start: tuple[float, float], actions: list[tuple[float, float]], end: tuple[float, float]
) -> None:
    hanger = bare_hanger(world, start)
    for action in actions:
        run_step(world, hanger, action)
    np.testing.assert_allclose(hanger.set_point[AXES], end, atol=1e-9)


def test_a_blocked_arm_does_not_wind_up(world: BulletWorld) -> None:
    """Against a wall (a stiff spring one centimetre ahead) the pull stays that of the lead, and ends at once."""
    hanger = bare_hanger(world)
    start = hanger.position()[0]
    for _ in range(25):
        hanger.start_step(np.array([0.01, 0.0]), 24)
        for _ in range(24):
            hanger.before_substep()
            place = hanger.position()
            wall = (-4000.0 * max(place[0] - start - 0.01, 0.0), 0.0, 0.0)
            hanger.arm.push_tool(np.array(wall), place)
            world.step()
    assert hanger.position()[0] - start < 0.015
    assert 0.02 < hanger.set_point[0] - hanger.position()[0] < MAX_LEAD_M + 1e-3
    for _ in range(4):
        run_step(world, hanger, (-0.01, 0.0))
    assert hanger.set_point[0] < start + 0.01


def test_follows_and_does_not_yield(world: BulletWorld) -> None:
    hanger = bare_hanger(world, control="position")
    for _ in range(10):
        run_step(world, hanger, (0.01, -0.01))
    np.testing.assert_allclose(hanger.position()[AXES], np.add(START, (0.1, -0.1)), atol=1e-3)
    before = hanger.position()
    for _ in range(5):
        torques = run_step(world, hanger, push_n=(4.0, 0.0, 0.0))
    assert np.linalg.norm(hanger.position() - before) < 0.001
    assert (torques <= panda.TORQUE_LIMIT_N_M + 1e-9).all()


def test_carries_a_towel(world: BulletWorld) -> None:
    """It sags by weight / stiffness, level, and the clips keep their corners, each its own."""
    spec = cloth_spec("towel")
    cloth = world.add_cloth(spec)
    hanger = watched(PandaHanger(cloth, spec.corners_at(0.0, spec.length_m + 0.1)))
    set_nodes(cloth, spec.hanging_nodes(hanger.corner_positions()))
    hanger.grasp()
    start = hanger.position()
    for step_index in range(12):
        run_step(world, hanger, (0.01, 0.0) if 5 <= step_index < 8 else (0.0, 0.0))
        held = cloth.nodes()[list(cloth.spec.corners)]
        np.testing.assert_allclose(held, hanger.corner_positions(), atol=1e-6)
    sag = start[2] - hanger.position()[2]
    assert sag == pytest.approx(cloth.spec.mass_kg * GRAVITY_M_S2 / 400.0, rel=0.15)
    assert sag < 0.002
    left, right = hanger.corner_positions()
    assert abs(left[2] - right[2]) < 0.001


@pytest.mark.slow
@pytest.mark.parametrize("name", ["towel", "napkin"])
@pytest.mark.parametrize("hem_m", [-0.002, 0.002])
def test_lays_it_flat_to_whichever_side_the_hem_has_flopped(name: str, hem_m: float) -> None:
    """A whole placement; x starts before the free edge touches."""
    spec = cloth_spec(name)
    with bullet_world(spec.rate_hz) as world:
        cloth = world.add_cloth(spec)
        hanger = watched(PandaHanger(cloth, spec.corners_at(0.0, spec.length_m + 0.1)))
        nodes = spec.hanging_nodes(hanger.corner_positions())
        nodes[np.setdiff1d(np.arange(len(nodes)), spec.corners), 0] += hem_m
        set_nodes(cloth, nodes)
        hanger.grasp()
        for _ in range(20):
            run_step(world, hanger)
        while cloth.nodes()[:, 2].min() > 0.04:
            run_step(world, hanger, (0.0, -0.01))
        while hanger.position()[2] > 0.0065:
            run_step(world, hanger, (0.0095, -0.01))
        for action in [(0.005, 0.0)] * 10 + [(0.0, 0.0)] * 10:
            run_step(world, hanger, action)
        nodes = cloth.nodes()
        assert cloth.divergence_reason(nodes) is None
        assert cloth.flat_area(nodes) > 0.95
        assert cloth.contact_portion_true(nodes) > 0.95
