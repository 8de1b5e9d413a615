"""Two arms: reach, joint limits, no contact between them, and a corner each."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.spatial import cKDTree

import layflat
from layflat.data.arrays import FloatArray
from layflat.policy.rollout import rollout
from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.robots.dual_arm import INNER_M, YAW_RAD, DualArm, base_positions_m, gripper_shape
from layflat.sim.robots.panda import TORQUE_LIMIT_N_M, inverse_kinematics
from layflat.sim.robots.registry import robot_spec
from layflat.tests.sim.helpers import simulation

JOINT_LOW = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973])
JOINT_HIGH = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])
"""Limits of the Panda's data sheet, rad."""
CLOTHS = ("towel", "napkin")


def reachable(cloth: str) -> list[FloatArray]:
    """Return pairs of corners at the ends of what both arms may reach, and between."""
    spec = cloth_spec(cloth)
    low, high = DualArm.workspace(spec)
    xs, zs = np.linspace(low[0], high[0], 4), np.linspace(low[2], high[2], 4)
    widths = (2 * INNER_M, spec.held_width_m)
    corners = [
        np.array([[x1, w / 2, z1], [x2, -w / 2, z2]]) for x1, x2, z1, z2, w in itertools.product(xs, xs, zs, zs, widths)
    ]
    return [DualArm.within_reach(pair, spec) for pair in corners]


def postures(corners: FloatArray, cloth: str) -> list[FloatArray]:
    bases = base_positions_m(cloth_spec(cloth))
    return [
        inverse_kinematics(*pair, yaw_rad=yaw) for *pair, yaw in zip(corners, bases, (YAW_RAD, -YAW_RAD), strict=True)
    ]


@pytest.mark.parametrize("cloth", CLOTHS)
def test_every_reachable_pair_is_within_the_joint_limits(cloth: str) -> None:
    for corners in reachable(cloth):
        for angles in postures(corners, cloth):
            assert (angles > JOINT_LOW).all(), (corners, angles)
            assert (angles < JOINT_HIGH).all(), (corners, angles)


def test_the_arms_never_touch() -> None:
    """The closest vertices of the two arms, wherever their corners may be."""
    bases = base_positions_m(cloth_spec("towel"))
    shapes = [gripper_shape(base) for base in bases]
    nearest = min(
        cKDTree(shapes[0].placed(first)).query(shapes[1].placed(second))[0].min()
        for first, second in (postures(corners, "towel") for corners in reachable("towel")[::7])
    )
    assert nearest > 0.05


def test_it_holds_and_moves_each_corner_on_its_own() -> None:
    with simulation("dual-arm", 3) as sim:
        start = sim.observe().corner_positions
        nodes = sim.ground_truth().nodes[list(sim.config.cloth_spec.corners)]
        np.testing.assert_allclose(nodes, start, atol=0.003)
        for _ in range(6):
            sim.step(np.array([0.005, 0.0, -0.005, 0.0, 0.0, -0.005]))
        for _ in range(4):
            sim.step(np.zeros(6))
        moved = sim.observe().corner_positions - start
        np.testing.assert_allclose(moved, [[0.03, 0.0, -0.03], [0.0, 0.0, -0.03]], atol=0.006)
        assert sim.joint_angles().shape == (14,)
        assert isinstance(sim.robot, DualArm)
        assert (np.abs(sim.robot.joint_torques()) < 0.9 * TORQUE_LIMIT_N_M).all()


def test_a_policy_of_the_pickers_fits_it() -> None:
    assert robot_spec("dual-arm").same_axes(robot_spec("pickers"))
    assert not robot_spec("dual-arm").same_axes(robot_spec("hanger"))


@pytest.mark.slow
@pytest.mark.parametrize("cloth", CLOTHS)
def test_the_demonstrator_lays_a_cloth_and_repairs_it(cloth: str) -> None:
    with simulation("dual-arm", 8, cloth=cloth) as sim:
        episode = rollout(sim, layflat.load_policy("scripted"), seed=8, disturbance="thesis")
    assert episode.contact_final > 0.97
    assert episode.flat_area_final is not None
    assert episode.flat_area_final > 0.97
