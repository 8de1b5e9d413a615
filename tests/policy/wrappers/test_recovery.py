"""What is folded is undone and laid again; what is flat, or gets flatter, is left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from layflat.data.robot import RobotSpec
from layflat.data.types import ACTION_LIMIT_M, Observation
from layflat.policy.base import Decision, continue_after_disturbance
from layflat.policy.wrappers.recovery import (
    CLEAR_M,
    FLAT_CONTACT,
    PLATEAU_STEPS,
    SMOOTH_STEPS,
    STUCK_STEPS,
    TRIES,
    WIPE_M,
    RecoveryWrapper,
)
from layflat.tests.factories import HANGER, PICKERS, ROBOT_SPECS

LENGTH_M = 0.35


class Layer:
    """Down and forward until the held edge lies, then stops."""

    name = "layer"

    def __init__(self, robot: RobotSpec) -> None:
        self.robot = robot
        self.begun = 0

    def reset(self, seed: int) -> None:
        self.begun += 1

    def continue_after_disturbance(self) -> None:
        """Nothing to forget."""

    def act(self, observation: Observation) -> Decision:
        zeros = np.zeros(self.robot.size)
        if observation.holder_position[2] <= 0.006:
            return Decision(action=zeros, stop="converged", reason="laid")
        return Decision(action=self.robot.pack([0.008, 0.0, -0.01]))


class Toy:
    """A cloth that hides ``hidden`` of itself once it lies, until it has hung free ``cures`` times."""

    def __init__(self, robot: RobotSpec, observe, *, hidden: float, cures: int = 1, half: float = 0.18) -> None:
        self.robot, self._observe, self._hidden, self._cures = robot, observe, hidden, cures
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
        seen = self._observe(x, z, contact=float(contact))
        return replace(seen, corner_positions=self.corners, free_edge_m=np.array([x, 0.0, lowest]))

    def move(self, action: np.ndarray) -> None:
        step = action.reshape(2, 3) if self.robot == PICKERS else np.array([action[0], 0.0, action[1]])
        self.corners = self.corners + step


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


@pytest.mark.parametrize("robot", ROBOT_SPECS)
def test_a_flat_cloth_is_left_alone(robot: RobotSpec, observe) -> None:
    policy = RecoveryWrapper(Layer(robot))
    policy.reset(0)
    decisions, contact = run(policy, Toy(robot, observe, hidden=0.0))
    assert policy.tried == []
    assert contact > FLAT_CONTACT
    assert all(decision.reason in ("", "laid") for decision in decisions)


@pytest.mark.parametrize("robot", ROBOT_SPECS)
def test_a_fold_is_lifted_once_and_laid_again(robot: RobotSpec, observe) -> None:
    inner = Layer(robot)
    policy = RecoveryWrapper(inner)
    policy.reset(3)
    decisions, contact = run(policy, Toy(robot, observe, hidden=0.25))
    assert policy.tried == ["lift"]
    assert contact > FLAT_CONTACT
    assert inner.begun == 2
    lifts = [decision.action for decision in decisions if "lifting" in decision.reason]
    # It begins and ends without a jerk: no move differs from the one before by more than a millimetre.
    heights = np.array([0.0, *(action[1 if robot == HANGER else 2] for action in lifts)])
    assert np.abs(np.diff(heights)).max() < 0.0011
    assert len(decisions) < 160 + policy.max_extra_steps


def test_what_a_lift_has_not_undone_is_wiped_over_the_table(observe) -> None:
    policy = RecoveryWrapper(Layer(HANGER))
    policy.reset(0)
    decisions, contact = run(policy, Toy(HANGER, observe, hidden=0.25, cures=2))
    assert policy.tried == ["lift", "wipe"]
    assert contact > FLAT_CONTACT
    wiping = [decision.action for decision in decisions if "wiping" in decision.reason]
    assert np.sum(wiping, axis=0) == pytest.approx([WIPE_M, 0.0])
    # Seen from where it hung free: as far down as it hung above the table, and some of the cloth more.
    down = np.sum([decision.action[1] for decision in decisions if "down" in decision.reason])
    assert -down > CLEAR_M
    assert -down < CLEAR_M + LENGTH_M / 4


@pytest.mark.parametrize("hidden", [0.25, 0.08])
def test_what_stays_folded_is_given_up_after_so_many_tries(hidden: float, observe) -> None:
    policy = RecoveryWrapper(Layer(HANGER))
    policy.reset(0)
    toy = Toy(HANGER, observe, hidden=hidden, cures=99)
    decisions, contact = run(policy, toy)
    assert len(policy.tried) == TRIES
    assert contact < FLAT_CONTACT
    assert decisions[-1].reason == "laid"
    continue_after_disturbance(policy)
    assert policy.tried == []
    run(policy, toy)
    assert len(policy.tried) == TRIES


def test_a_little_that_is_hidden_is_turned_over_first(observe) -> None:
    policy = RecoveryWrapper(Layer(HANGER))
    policy.reset(0)
    decisions, _ = run(policy, Toy(HANGER, observe, hidden=0.08, cures=1))
    assert policy.tried == ["turn", "lift"]
    turning = np.array([decision.action for decision in decisions if "turning" in decision.reason])
    path = turning.cumsum(axis=0)
    assert path[:, 1].max() > 0.04
    assert path[-1, 0] > 0.05
    assert path[-1, 1] == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize(("moved", "width"), [(-0.03, 0.36), (0.02, 0.38)])
def test_two_pickers_come_back_side_by_side_as_wide_as_they_ever_were(moved: float, width: float, observe) -> None:
    policy = RecoveryWrapper(Layer(PICKERS))
    policy.reset(0)
    toy = Toy(PICKERS, observe, hidden=0.25)
    toy.corners = toy.corners + np.array([[0.01, 0.0, 0.0], [0.0, 0.0, 0.03]])  # The start is aslant.
    policy.act(toy.see())
    toy.corners = toy.corners + np.array([[-0.02, moved, 0.02], [0.0, 0.0, 0.0]])
    run(policy, toy)
    assert policy.tried == ["lift"]
    np.testing.assert_allclose(toy.corners[0] - toy.corners[1], [0.0, width, 0.0], atol=1e-9)


class Forward(Layer):
    """Drags to the front for ever."""

    def act(self, observation: Observation) -> Decision:
        return Decision(action=self.robot.pack([0.004, 0.0, 0.0]))


@pytest.mark.parametrize(("slope", "undone"), [(0.0, True), (0.004, False)])
def test_noise_on_a_plateau_is_no_gain_and_a_slow_gain_is_one(slope: float, undone: bool, observe) -> None:
    rng = np.random.default_rng(4)
    policy = RecoveryWrapper(Forward(HANGER))
    policy.reset(0)
    for step_index in range(2 * PLATEAU_STEPS):
        contact = min(0.78 + slope * step_index, 1.0) + rng.normal(0.0, 0.008)
        policy.act(observe(0.3 + 0.004 * step_index, 0.005, contact=float(np.clip(contact, 0, 1)), word=(0.05, 0.0)))
    assert bool(policy.tried) is undone


@pytest.mark.parametrize(("strength", "n_steps"), [(0.0, SMOOTH_STEPS), (0.01, SMOOTH_STEPS), (0.05, PLATEAU_STEPS)])
def test_a_plateau_without_wrinkles_is_known_for_a_fold_sooner(strength: float, n_steps: int, observe) -> None:
    policy = RecoveryWrapper(Forward(HANGER))
    policy.reset(0)
    for step_index in range(1, PLATEAU_STEPS + 1):
        policy.act(observe(0.3 + 0.004 * step_index, 0.005, contact=0.78, word=(strength, 0.0)))
        assert bool(policy.tried) is (step_index >= n_steps)
        if policy.tried:
            break


def test_a_smooth_cloth_that_is_being_laid_is_let_be(observe) -> None:
    """No wrinkle is seen while contact grows by a hundredth a step, and the cloth is no fold."""
    policy = RecoveryWrapper(Forward(HANGER))
    policy.reset(0)
    for step_index in range(60):
        policy.act(observe(0.1 + 0.008 * step_index, 0.005, contact=0.31 + 0.01 * step_index))
    assert policy.tried == []


def test_a_holder_that_hovers_is_stuck_and_one_that_descends_is_not(observe) -> None:
    for speed, stuck in ((0.0005, True), (0.004, False)):
        policy = RecoveryWrapper(Forward(HANGER))
        policy.reset(0)
        for step_index in range(STUCK_STEPS + 1):
            policy.act(observe(0.1, 0.25 - speed * step_index))
        assert bool(policy.tried) is stuck
