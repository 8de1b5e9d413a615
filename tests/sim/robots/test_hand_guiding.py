"""Kinesthetic teaching by what a hand feels and where the hanger goes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from layflat.data.types import ACTION_LIMIT_M
from layflat.sim.errors import SimError
from layflat.sim.physics.bullet.world import BulletWorld
from layflat.sim.robots import hand_guiding, panda
from layflat.tests.sim.helpers import bullet_world, simulation
from layflat.tests.sim.robots.hangers import AXES, START, bare_hanger, guided_step, joint_torques, run_step


@pytest.fixture
def world() -> Iterator[BulletWorld]:
    """Give a world with the presets' step."""
    with bullet_world(200) as made:
        yield made


@pytest.mark.parametrize("axis", AXES)
def test_it_stays_without_a_hand_and_yields_to_more_than_its_friction_along_x_and_z(
    world: BulletWorld, axis: int
) -> None:
    """1 N would move the springs of the impedance by 2.5 mm, and 0.25 N is less than friction."""
    moved = {}
    for newtons in (0.0, 0.25, 1.0):
        hanger = bare_hanger(world)
        before = hanger.position()
        for _ in range(10 if newtons else 20):
            guided_step(world, hanger, push_n=tuple(newtons * np.eye(3)[axis]))
            assert newtons or np.abs(hanger.position() - before).max() < 1e-4
        moved[newtons] = hanger.position()[axis] - before[axis]
    assert 0 < moved[0.25] < 0.002
    # Steady speed: (1 N - friction) / damping.
    assert moved[1.0] > 0.02


def test_it_keeps_its_springs_along_y_and_its_bar_level(world: BulletWorld) -> None:
    hanger = bare_hanger(world)
    before = hanger.position()
    for _ in range(20):
        guided_step(world, hanger, push_n=(0.0, 4.0, 0.0))
    assert hanger.position()[1] - before[1] == pytest.approx(0.01, abs=5e-4)
    left, right = hanger.corner_positions()
    assert abs(left[2] - right[2]) < 0.001


def test_a_load_that_is_carried_does_not_sink_it_and_one_that_is_not_does(world: BulletWorld) -> None:
    fallen = {}
    for load in (0.0, 2.0):
        hanger = bare_hanger(world)
        before = hanger.position()[2]
        for _ in range(10):
            guided_step(world, hanger, push_n=(0.0, 0.0, -2.0), load_n=load)
        fallen[load] = before - hanger.position()[2]
    assert abs(fallen[2.0]) < 0.002
    assert fallen[0.0] > 0.05


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, -1.0), (0.6, -0.8)])
def test_it_follows_a_hand(world: BulletWorld, direction: tuple[float, float]) -> None:
    """At 5 cm/s: the hand feels friction and damping, and lags by that over its own stiffness."""
    hanger = bare_hanger(world)
    hand = hanger.position()
    felt_n = hand_guiding.FRICTION_N + 12.0 * 0.05
    for step_index in range(25):
        hand = hand + 0.005 * np.array([direction[0], 0.0, direction[1]])
        force = guided_step(world, hanger, hand)
        if step_index > 10:
            assert np.linalg.norm((hand - hanger.position())[AXES]) < 0.006
            assert np.linalg.norm(force) == pytest.approx(felt_n, rel=0.25)


def test_a_flung_hand_pulls_no_harder_than_its_limit(world: BulletWorld) -> None:
    hanger = bare_hanger(world, (0.25, 0.3))
    rng = np.random.default_rng(1)
    for _ in range(40):
        before = hanger.position()
        force = guided_step(world, hanger, rng.uniform(-3.0, 3.0, 3))
        assert np.linalg.norm(force) <= hand_guiding.HAND_LIMIT_N + 1e-9
        assert np.abs(hanger.position() - before).max() < ACTION_LIMIT_M
        assert (np.abs(joint_torques(hanger)) <= panda.TORQUE_LIMIT_N_M).all()


@pytest.mark.parametrize("hand", [(0.25, 0.0, -1.0), (2.0, 0.0, 0.3), (-2.0, 0.0, 0.3), (0.25, 0.0, 2.0)])
def test_it_stays_in_its_workspace(world: BulletWorld, hand: tuple[float, float, float]) -> None:
    hanger = bare_hanger(world, (0.25, 0.1))
    for _ in range(60):
        guided_step(world, hanger, np.array(hand))
    for _ in range(10):
        guided_step(world, hanger)
    place = hanger.position()
    assert 0.0 < place[2] < 0.56
    assert -0.106 < place[0] < 0.606


def test_the_springs_take_over_without_a_jump(world: BulletWorld) -> None:
    hanger = bare_hanger(world)
    hand = hanger.position()
    for step_index in range(15):
        hand = hand + np.array([0.005, 0.0, -0.003]) * (step_index < 10)
        guided_step(world, hanger, hand, load_n=0.5, push_n=(0.0, 0.0, -0.5))
    before = hanger.position()
    assert before[0] > START[0] + 0.04
    for _ in range(3):
        run_step(world, hanger, push_n=(0.0, 0.0, -0.5))
    assert np.abs(hanger.position() - before).max() < 0.001
    run_step(world, hanger, (0.005, 0.0))
    assert hanger.position()[0] - before[0] == pytest.approx(0.005, abs=0.002)


def test_the_displacements_are_what_happened_and_can_be_repeated() -> None:
    with simulation("hanger", 1) as sim:
        start = sim.robot.position()
        hand, actions = start.copy(), []
        for step_index in range(16):
            hand = hand + (np.array([0.006, 0.0, -0.006]) if step_index < 12 else 0.0)
            actions.append(sim.guide(hand))
            assert sim.divergence_reason() is None
        end = sim.robot.position()
        np.testing.assert_allclose(np.sum(actions, axis=0), (end - start)[AXES], atol=1e-9)
        assert np.linalg.norm((end - hand)[AXES]) < 0.004
        sim.reset(1)
        for action in actions:
            sim.step(action)
        np.testing.assert_allclose(sim.robot.position(), end, atol=0.003)


def test_left_alone_it_carries_its_cloth() -> None:
    with simulation("hanger") as sim:
        for _ in range(3):
            sim.step(np.zeros(2))  # at rest: what moves coasts some millimetres further
        before = sim.robot.position()
        for _ in range(15):
            sim.guide(None)
        # It gives way to the swinging cloth a little, and does not sink.
        assert np.abs(sim.robot.position() - before).max() < 0.002


def test_pickers_follow_their_hands_at_a_bounded_speed() -> None:
    with simulation() as sim:
        hands = sim.robot.corner_positions() + np.array([[0.03, 0.0, 0.01], [0.02, 0.0, 0.01]])
        first = sim.guide(hands)
        assert first.shape == (6,)
        fastest = hand_guiding.HAND_SPEED_M_S * sim.spec.step_s
        np.testing.assert_allclose(np.linalg.norm(first.reshape(2, 3), axis=1), fastest, rtol=1e-6)
        for _ in range(3):
            sim.guide(hands)
        np.testing.assert_allclose(sim.robot.corner_positions(), hands, atol=1e-9)
        before = sim.robot.corner_positions()
        assert not sim.guide(None).any()
        np.testing.assert_array_equal(sim.robot.corner_positions(), before)


@pytest.mark.parametrize("robot", ["hanger", "pickers"])
def test_invalid_hands_are_refused_and_stiff_joints_do_not_yield(world: BulletWorld, robot: str) -> None:
    with pytest.raises(SimError, match="impedance"):
        bare_hanger(world, control="position").start_guided_step(None, 20, 0.0)
    with simulation(robot) as sim:
        for wrong in (np.zeros(2), np.full(sim.spec.robot.hand_shape, np.nan)):
            with pytest.raises(SimError, match="hand's target"):
                sim.guide(wrong)
