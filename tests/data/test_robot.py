"""A robot's action axes: which number of an action moves which point along which axis of the world."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.data.robot import ActionAxis, RobotSpec, one_point, two_points
from layflat.tests.factories import make_episode

LIFTER = RobotSpec(
    name="lifter",
    axes=(
        ActionAxis(name="dz2", point=1, axis=2),
        ActionAxis(name="dy1", point=0, axis=1),
        ActionAxis(name="dz1", point=0, axis=2),
    ),
)
"""Its axes are neither complete nor in the order of the points."""
ROBOTS = (LIFTER, two_points("pickers"), one_point("hanger", dx=0, dz=2))


@pytest.mark.parametrize("robot", ROBOTS, ids=str)
def test_each_number_of_an_action_moves_its_own_point_along_its_own_axis_alone(robot):
    for index, axis in enumerate(robot.axes):
        action = robot.zeros()
        action[index] = 0.01
        moves = robot.unpack(action)
        assert np.argwhere(moves).tolist() == [[axis.point, axis.axis]]
        np.testing.assert_array_equal(robot.pack(moves), action)


@pytest.mark.parametrize("robot", ROBOTS, ids=str)
def test_an_action_of_moves_is_these_moves_along_the_axes_that_the_robot_has(robot):
    moves = np.arange(1.0, 1.0 + 3 * robot.n_points).reshape(robot.n_points, 3)
    packed = robot.pack(moves)
    assert len(set(packed)) == robot.size
    again = robot.unpack(packed)
    np.testing.assert_array_equal(again[again != 0], moves[again != 0])


def test_one_row_moves_all_points_alike():
    assert LIFTER.pack([1.0, 2.0, 3.0]).tolist() == [3.0, 2.0, 3.0]


def test_the_position_is_that_of_the_points_which_the_axes_move():
    seen = make_episode("pickers").final_observation
    (_, y1, z1), (_, _, z2) = seen.corner_positions
    assert LIFTER.position(seen).tolist() == [z2, y1, z1]
