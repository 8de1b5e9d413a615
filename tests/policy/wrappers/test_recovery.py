"""A folded cloth is lifted and laid again; one that is flat, or gets flatter, is left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from layflat.data.robot import RobotSpec
from layflat.data.types import ACTION_LIMIT_M, Observation
from layflat.policy.base import Decision, continue_after_disturbance
from layflat.policy.wrappers import recovery
from layflat.policy.wrappers.recovery import CLEAR_M, FLAT_CONTACT, PLATEAU_STEPS, SMOOTH_STEPS, TRIES, RecoveryWrapper
from layflat.tests.factories import HANGER, PICKERS, ROBOT_SPECS
from layflat.tests.policy.factories import observe

LENGTH_M = 0.35


class Layer:
    """Down and forward until the held edge lies, then stops."""

    name = "layer"

    def __init__(self, robot: RobotSpec):
        self.robot = robot
        self.seeds: list[int] = []

    def reset(self, seed: int):
        self.seeds.append(seed)

    def act(self, observation: Observation) -> Decision:
        zeros = self.robot.zeros()
        if observation.holder_position[2] <= 0.006:
            return Decision(action=zeros, stop="converged", reason="laid")
        return Decision(action=self.robot.pack([0.008, 0.0, -0.01]))


class Toy:
    """A cloth that hides ``hidden`` of itself once it lies, until it has hung free ``cures`` times."""

    def __init__(self, robot: RobotSpec, *, hidden: float, cures: int = 1, half: float = 0.18):
        self.robot, self._hidden, self._cures = robot, hidden, cures
        self.corners = np.array([[0.0, half, 0.47], [0.0, -half, 0.47]])
        self._was_down = False

    def see(self) -> Observation:
        x, _, z = self.corners.mean(axis=0)
        lowest = max(z - LENGTH_M, 0.0)
        if lowest > 0.9 * CLEAR_M and self._was_down:
            self._cures, self._was_down = self._cures - 1, False
        self._was_down = self._was_down or z < 0.01
        laid = np.clip(1.0 - z / LENGTH_M, 0.0, 1.0)
        contact = laid if self._cures <= 0 else laid * (1.0 - self._hidden)
        seen = observe(x, z, contact=float(contact), free_edge_m=(x, 0.0, lowest))
        return replace(seen, corner_positions=self.corners)

    def move(self, action: np.ndarray):
        self.corners = self.corners + self.robot.unpack(action)


class Forward(Layer):
    """Drags to the front without end."""

    def act(self, observation: Observation) -> Decision:
        return Decision(action=self.robot.pack([0.004, 0.0, 0.0]))


def recovering(policy: Layer, seed: int = 0) -> RecoveryWrapper:
    wrapped = RecoveryWrapper(policy)
    wrapped.reset(seed)
    return wrapped


def run(policy: RecoveryWrapper, toy: Toy, n_steps: int = 2000) -> tuple[list[Decision], float]:
    """All decisions until the stop, and the contact in the end."""
    decisions = []
    for _ in range(n_steps):
        seen = toy.see()
        decisions.append(policy.act(seen))
        if decisions[-1].stop is not None:
            return decisions, seen.contact_portion
        assert np.abs(decisions[-1].action).max() <= ACTION_LIMIT_M + 1e-12
        toy.move(decisions[-1].action)
    raise AssertionError("it never stops")


def moves(decisions: list[Decision], reason: str) -> np.ndarray:
    return np.array([decision.action for decision in decisions if reason in decision.reason])


@pytest.mark.parametrize("robot", ROBOT_SPECS)
def test_a_flat_cloth_is_left_alone_and_a_fold_is_lifted_once_and_laid_again(robot):
    policy = recovering(Layer(robot))
    decisions, contact = run(policy, Toy(robot, hidden=0.0))
    assert policy.tried == []
    assert contact > FLAT_CONTACT
    assert all(decision.reason in ("", "laid") for decision in decisions)
    inner = Layer(robot)
    policy = recovering(inner, seed=3)
    decisions, contact = run(policy, Toy(robot, hidden=0.25))
    assert policy.tried == ["lift"]
    assert contact > FLAT_CONTACT
    assert inner.seeds == [3, 3]
    # It begins and ends without a jerk: no move differs from the one before by more than a millimetre.
    heights = np.array([0.0, *(robot.unpack(action)[0, 2] for action in moves(decisions, "lifting"))])
    assert np.abs(np.diff(heights)).max() < 0.0011
    assert len(decisions) < 160 + policy.max_extra_steps


def test_a_fold_that_survives_a_lift_is_wiped_over_the_table():
    policy = recovering(Layer(HANGER))
    decisions, contact = run(policy, Toy(HANGER, hidden=0.25, cures=2))
    assert policy.tried == ["lift", "wipe"]
    assert contact > FLAT_CONTACT
    assert np.sum(moves(decisions, "wiping"), axis=0) == pytest.approx([recovery.WIPE_M, 0.0])
    # From where it hung free, down by its height above the table and by some of the cloth.
    assert CLEAR_M < -moves(decisions, "down")[:, 1].sum() < CLEAR_M + LENGTH_M / 4


@pytest.mark.parametrize("hidden", [0.25, 0.08])
def test_the_tries_are_limited_and_start_again_after_a_disturbance(hidden: float):
    policy = recovering(Layer(HANGER))
    toy = Toy(HANGER, hidden=hidden, cures=99)
    decisions, contact = run(policy, toy)
    assert len(policy.tried) == TRIES
    assert contact < FLAT_CONTACT
    assert decisions[-1].reason == "laid"
    continue_after_disturbance(policy)
    assert policy.tried == []
    run(policy, toy)
    assert len(policy.tried) == TRIES


def test_a_small_fold_is_turned_over_first():
    policy = recovering(Layer(HANGER))
    decisions, _ = run(policy, Toy(HANGER, hidden=0.08, cures=1))
    assert policy.tried == ["turn", "lift"]
    path = moves(decisions, "turning").cumsum(axis=0)
    assert path[:, 1].max() > 0.04
    assert path[-1, 0] > 0.05
    assert path[-1, 1] == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize(("moved", "width"), [(-0.03, 0.36), (0.02, 0.38)])
def test_two_pickers_come_back_side_by_side_as_wide_as_they_ever_were(moved: float, width: float):
    policy = recovering(Layer(PICKERS))
    toy = Toy(PICKERS, hidden=0.25)
    toy.corners = toy.corners + np.array([[0.01, 0.0, 0.0], [0.0, 0.0, 0.03]])  # The start is aslant.
    policy.act(toy.see())
    toy.corners = toy.corners + np.array([[-0.02, moved, 0.02], [0.0, 0.0, 0.0]])
    run(policy, toy)
    assert policy.tried == ["lift"]
    np.testing.assert_allclose(toy.corners[0] - toy.corners[1], [0.0, width, 0.0], atol=1e-9)


@pytest.mark.parametrize(("slope", "undone"), [(0.0, True), (0.004, False)])
def test_noise_on_a_plateau_is_no_gain_and_a_slow_gain_is_one(slope: float, undone: bool):
    rng = np.random.default_rng(4)
    policy = recovering(Forward(HANGER))
    for k in range(2 * PLATEAU_STEPS):
        contact = min(0.78 + slope * k, 1.0) + rng.normal(0.0, 0.008)
        policy.act(observe(0.3 + 0.004 * k, 0.005, contact=float(np.clip(contact, 0, 1)), word=(0.05, 0.0)))
    assert bool(policy.tried) is undone


@pytest.mark.parametrize(("strength", "n_steps"), [(0.0, SMOOTH_STEPS), (0.01, SMOOTH_STEPS), (0.05, PLATEAU_STEPS)])
def test_a_plateau_without_wrinkles_counts_as_a_fold_sooner(strength: float, n_steps: int):
    policy = recovering(Forward(HANGER))
    for k in range(1, PLATEAU_STEPS + 1):
        policy.act(observe(0.3 + 0.004 * k, 0.005, contact=0.78, word=(strength, 0.0)))
        assert bool(policy.tried) is (k >= n_steps)
        if policy.tried:
            break


def test_a_smooth_cloth_that_is_being_laid_is_left_alone_and_a_holder_that_hovers_is_stuck():
    policy = recovering(Forward(HANGER))
    for k in range(60):
        policy.act(observe(0.1 + 0.008 * k, 0.005, contact=0.31 + 0.01 * k))
    assert policy.tried == []
    for speed, stuck in ((0.0005, True), (0.004, False)):
        policy = recovering(Forward(HANGER))
        for k in range(recovery.STUCK_STEPS + 1):
            policy.act(observe(0.1, 0.25 - speed * k))
        assert bool(policy.tried) is stuck
