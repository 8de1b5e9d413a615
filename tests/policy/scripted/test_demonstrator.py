"""The scripted demonstrator against a cloth of rods: hangs straight, rests where it touched, lies flat when pulled."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from layflat.data.types import ACTION_LIMIT_M, GroundTruth
from layflat.policy.base import continue_after_disturbance
from layflat.policy.scripted.demonstrator import (
    DRAG_STEP_M,
    FLAT_CONTACT,
    LAND_STEP_M,
    LAY_STEP_M,
    ScriptedDemonstrator,
    keep_taut,
)
from layflat.tests.factories import HANGER, PICKERS, ROBOT_SPECS
from layflat.tests.policy.factories import observe

LENGTH_M, WIDTH_M, COLUMNS = 0.35, 0.36, 3


class RodCloth:
    """A cloth whose free edge hangs below the holder, stays where it touches, and slides only when it is taut."""

    def __init__(self, robot, start=(0.0, 0.47)):
        self.robot = robot
        self.corners = np.array([[start[0], WIDTH_M / 2, start[1]], [start[0], -WIDTH_M / 2, start[1]]])
        self.edge_x = start[0]
        self.wrinkle_m = 0.0
        """Slack that a disturbance pulled into the cloth."""

    @property
    def holder(self):
        return self.corners.mean(axis=0)

    def ground_truth(self):
        x, _, z = self.holder
        lowest = max(0.004, z - LENGTH_M)
        nodes = np.array([[self.edge_x, y, lowest] for y in (WIDTH_M / 2, 0, -WIDTH_M / 2)] + [[x, 0.0, z]] * 6)
        return GroundTruth(nodes=nodes, contact_portion_true=self.contact(), flat_area=self.contact())

    def contact(self):
        x, _, z = self.holder
        if z > 0.02:
            return 0.0 if z > LENGTH_M else 1.0 - z / LENGTH_M
        return float(np.clip(1.0 - 2.0 * (LENGTH_M + self.edge_x - x + self.wrinkle_m) / LENGTH_M, 0.0, 1.0))

    def move(self, action):
        self.corners = self.corners + self.robot.unpack(action)
        self.corners[:, 2] = np.maximum(self.corners[:, 2], 0.004)
        x, _, z = self.holder
        if z > LENGTH_M + 0.01:
            self.edge_x = x
        self.edge_x = max(self.edge_x, x - LENGTH_M - self.wrinkle_m - 1e-9)

    def see(self, k):
        seen = observe(contact=self.contact(), time_s=0.1 * k)
        return replace(seen, corner_positions=self.corners, holder_position=self.holder)


def demonstrator_for(cloth, seed=0):
    policy = ScriptedDemonstrator(
        cloth.robot, length_m=LENGTH_M, columns=COLUMNS, held_width_m=WIDTH_M, ground_truth=cloth.ground_truth
    )
    policy.reset(seed)
    return policy


def demonstrate(cloth, demonstrator, limit=200):
    decisions = []
    for k in range(limit):
        decisions.append(demonstrator.act(cloth.see(k)))
        if decisions[-1].stop:
            return decisions
        cloth.move(decisions[-1].action)
    pytest.fail(f"no stop within {limit} steps; the last clause was {decisions[-1].reason!r}")


@pytest.mark.parametrize("robot", ROBOT_SPECS)
@pytest.mark.parametrize("seed", range(6))
def test_lays_the_cloth_within_the_limits_and_repairs_it_after_a_disturbance(robot, seed):
    cloth = RodCloth(robot)
    demonstrator = demonstrator_for(cloth, seed)
    for _ in range(2):
        decisions = demonstrate(cloth, demonstrator)
        assert decisions[-1].stop == "converged"
        assert cloth.contact() >= FLAT_CONTACT
        assert max(np.abs(d.action).max() for d in decisions) <= ACTION_LIMIT_M
        assert not decisions[-1].action.any()
        cloth.wrinkle_m += 0.03
        assert cloth.contact() < 0.9
        continue_after_disturbance(demonstrator)


@pytest.mark.parametrize("robot", ROBOT_SPECS)
def test_the_free_edge_trails_before_anything_is_laid_on_it(robot):
    cloth = RodCloth(robot)
    demonstrator = demonstrator_for(cloth, 3)
    while (decision := demonstrator.act(cloth.see(0))).reason != "laying":
        assert decision.stop is None
        cloth.move(decision.action)
    assert cloth.holder[0] - cloth.edge_x > 0.04


@pytest.mark.parametrize("robot", ROBOT_SPECS)
def test_the_drag_is_faster_the_less_contact_there_is_at_the_same_place(robot):
    def drag_speed(wrinkle_m):
        cloth = RodCloth(robot)
        demonstrator = demonstrator_for(cloth, 1)
        demonstrate(cloth, demonstrator)
        cloth.wrinkle_m = wrinkle_m
        continue_after_disturbance(demonstrator)
        return demonstrator.act(cloth.see(0)).action[0]

    speeds = [drag_speed(w) for w in (0.013, 0.019, 0.025)]
    assert speeds == sorted(speeds)
    assert DRAG_STEP_M[0] <= speeds[0] < speeds[-1] <= DRAG_STEP_M[1] + 0.006


def test_gives_up_where_dragging_gains_nothing():
    class Stuck(RodCloth):
        def contact(self):
            return min(super().contact(), 0.8)

    cloth = Stuck(HANGER)
    assert demonstrate(cloth, demonstrator_for(cloth))[-1].stop == "converged"
    assert cloth.holder[0] < LENGTH_M + 0.3


def test_demonstrations_begin_their_descent_at_different_places():
    """From one place everything would happen at the same x, and a learner could not tell x from contact."""
    ends = []
    for seed in range(8):
        cloth = RodCloth(HANGER)
        demonstrate(cloth, demonstrator_for(cloth, seed))
        ends.append(cloth.holder[0])
    assert np.ptp(ends) > 0.05


def test_two_pickers_come_back_to_their_lines():
    cloth = RodCloth(PICKERS)
    cloth.corners = cloth.corners + np.array([[0.03, -0.02, 0.02], [-0.02, 0.03, -0.02]])
    demonstrate(cloth, demonstrator_for(cloth))
    np.testing.assert_allclose(cloth.corners[:, 1], [WIDTH_M / 2, -WIDTH_M / 2], atol=0.002)
    np.testing.assert_allclose(cloth.corners[0, [0, 2]], cloth.corners[1, [0, 2]], atol=0.002)


@given(
    laid=st.floats(0.0, 0.27), height=st.floats(0.003, 0.27), dx=st.floats(0.004, 0.012), dz=st.floats(-0.012, -0.0015)
)
def test_a_small_cloth_is_laid_tautly(laid, height, dx, dz):
    """The step leaves the edges as far apart as they should be, or goes there as fast as any; it always descends."""
    taut = 0.82 * 0.275
    ahead, down = keep_taut(dx, dz, laid, height, taut)
    distance = np.hypot(laid + ahead, max(height + down, 0.0))
    assert distance >= taut - 1e-9 or ahead >= LAY_STEP_M - 1e-12
    assert ahead >= dx
    assert dz <= down <= -LAND_STEP_M
    if np.hypot(laid + dx, max(height + dz, 0.0)) >= taut:
        assert (ahead, down) == (dx, dz)
