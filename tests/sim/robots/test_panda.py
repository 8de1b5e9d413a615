"""The Panda's description and inverse kinematics."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET

import numpy as np
import pybullet as bullet
import pybullet_data
import pytest

from layflat.sim.errors import SimError
from layflat.sim.physics.bullet.arm import BulletArm
from layflat.sim.physics.bullet.world import BulletWorld
from layflat.sim.robots import panda, panda_description
from layflat.sim.robots.hanger import MAX_SIDE_M, PandaHanger
from layflat.tests.sim.robots.hangers import JOINT_HIGH_RAD, JOINT_LOW_RAD, bare_hanger, run_step

ORIGINAL = os.path.join(pybullet_data.getDataPath(), "franka_panda", "panda.urdf")
WRIST = panda.JOINTS - 1


def _arm(world: BulletWorld, clip_distance_m: float) -> BulletArm:
    urdf = panda_description.arm_urdf(clip_distance_m)
    return world.add_arm(urdf, panda.BASE_POSITION_M, joints=panda.JOINTS, tool_m=panda.TOOL_M)


def test_constants_are_those_of_the_original() -> None:
    joints = {j.get("name"): j for j in ET.parse(ORIGINAL).getroot().findall("joint")}
    arm = [joints[f"panda_joint{i}"] for i in range(1, 8)]
    assert [float(j.find("limit").get("effort")) for j in arm] == panda.TORQUE_LIMIT_N_M.tolist()
    soft = [j.find("safety_controller") for j in arm]
    assert [float(s.get("soft_lower_limit")) for s in soft] == JOINT_LOW_RAD.tolist()
    assert [float(s.get("soft_upper_limit")) for s in soft] == JOINT_HIGH_RAD.tolist()
    origin = [[float(v) for v in j.find("origin").get("xyz").split()] for j in [*arm, joints["panda_joint8"]]]
    assert origin[0] == [0, 0, panda.SHOULDER_HEIGHT_M]
    assert origin[2] == [0, -panda.UPPER_ARM_M, 0]
    assert origin[3] == [panda.ELBOW_OFFSET_M, 0, 0]
    assert origin[4] == [-panda.ELBOW_OFFSET_M, panda.FOREARM_M, 0]
    assert origin[6] == [panda.WRIST_OFFSET_M, 0, 0]
    assert origin[7] == [0, 0, panda.FLANGE_M]
    yaw = float(joints["panda_hand_joint"].find("origin").get("rpy").split()[2])
    assert yaw == pytest.approx(panda.HAND_YAW_RAD)
    finger = joints["panda_finger_joint1"].find("origin").get("xyz").split()
    assert float(finger[2]) == panda_description.FINGER_HEIGHT_M


def test_masses_and_centre_of_mass_are_the_originals_plus_the_hanger(world: BulletWorld) -> None:
    """The wrist merged into one link keeps its mass and its centre: the original, loaded as it is, is the judge."""
    client = world.client
    options = {"useFixedBase": True, "flags": bullet.URDF_IGNORE_VISUAL_SHAPES, "physicsClientId": client}
    original = bullet.loadURDF(ORIGINAL, panda.BASE_POSITION_M, **options)
    arm = _arm(world, 0.36)
    ours = arm.body
    angles = panda.inverse_kinematics(np.array([0.0, 0.0, 0.4]))
    arm.reset_joints(angles)
    for joint, angle in enumerate(angles):
        bullet.resetJointState(original, joint, float(angle), 0.0, physicsClientId=client)
    links = range(bullet.getNumJoints(original, physicsClientId=client))
    masses = [bullet.getDynamicsInfo(original, i, physicsClientId=client)[0] for i in links]
    places = [
        np.array(bullet.getLinkState(original, i, computeForwardKinematics=1, physicsClientId=client)[0]) for i in links
    ]
    for i in range(panda.JOINTS - 1):
        assert bullet.getDynamicsInfo(ours, i, physicsClientId=client)[0] == masses[i]
    added = panda_description.BAR_MASS_KG + 2 * panda_description.CLIP_MASS_KG
    assert 0.15 <= added <= 0.25
    wrist = bullet.getDynamicsInfo(ours, WRIST, physicsClientId=client)
    assert wrist[0] == pytest.approx(sum(masses[6:]) + added)
    # The hand points down: bar and clips hang at known heights above the corners.
    heights = {panda.CLIP_DROP_M: panda_description.BAR_MASS_KG}
    heights[panda.CLIP_DROP_M / 2] = 2 * panda_description.CLIP_MASS_KG
    hanging = [(mass, np.array([0.0, 0.0, 0.4 + up])) for up, mass in heights.items()]
    moment = sum(m * p for m, p in [*zip(masses[6:], places[6:], strict=True), *hanging])
    state = bullet.getLinkState(ours, WRIST, computeForwardKinematics=1, physicsClientId=client)
    np.testing.assert_allclose(state[0], moment / wrist[0], atol=1e-6)


@pytest.mark.parametrize("distance", [0.2, 0.36])
def test_inertias_belong_to_real_bodies_which_touch_nothing(world: BulletWorld, distance: float) -> None:
    arm = _arm(world, distance).body
    for link in range(-1, panda.JOINTS):
        assert not bullet.getCollisionShapeData(arm, link, physicsClientId=world.client)
    for link in range(panda.JOINTS):
        inertia = np.array(bullet.getDynamicsInfo(arm, link, physicsClientId=world.client)[2])
        assert inertia.min() > 0
        assert (inertia.sum() >= 2 * inertia).all()  # each at most the sum of the others


def test_a_wider_hanger_is_harder_to_turn(world: BulletWorld) -> None:
    """Two clips and a bar of length l further out: the difference is that of point masses and rods, by hand."""
    inertia = [
        np.array(bullet.getDynamicsInfo(_arm(world, d).body, 6, physicsClientId=world.client)[2]) for d in (0.2, 0.4)
    ]
    clips = 2 * panda_description.CLIP_MASS_KG * (0.2**2 - 0.1**2)
    width = panda_description.CLIP_SIZE_M[1]
    bar = panda_description.BAR_MASS_KG / 12 * ((0.4 + width) ** 2 - (0.2 + width) ** 2)
    np.testing.assert_allclose(inertia[1] - inertia[0], [clips + bar, 0.0, clips + bar], atol=1e-9)


def test_whole_workspace_hand_down_with_margin(world: BulletWorld) -> None:
    hanger = bare_hanger(world)
    for x in np.linspace(PandaHanger.workspace_low_m[0], PandaHanger.workspace_high_m[0], 8):
        for z in np.linspace(PandaHanger.workspace_low_m[2], PandaHanger.workspace_high_m[2], 7):
            for y in (-MAX_SIDE_M, MAX_SIDE_M):
                angles = panda.inverse_kinematics(np.array([x, y, z]))
                assert np.minimum(angles - JOINT_LOW_RAD, JOINT_HIGH_RAD - angles).min() > 0.25
                # The elbow never comes near straight (about -0.47 rad), where the arm could not yield outwards.
                assert angles[3] < -0.9
                hanger.arm.reset_joints(angles)
                place, rotation = hanger.arm.tool_pose()
                np.testing.assert_allclose(place, [x, y, z], atol=1e-6)
                np.testing.assert_allclose(rotation, np.diag([1, -1, -1]), atol=1e-6)


def test_a_bad_distance_of_the_clips_and_a_point_out_of_reach_are_refused() -> None:
    with pytest.raises(SimError, match="apart"):
        panda_description.arm_urdf(float("nan"))
    with pytest.raises(SimError, match="cannot reach"):
        panda.inverse_kinematics(np.array([1.6, 0.0, 0.3]))


def test_bar_and_fingers_stay_above_the_table() -> None:
    lowest_finger = panda.CLIP_DROP_M + panda.GRIP_DEPTH_M - (panda_description.FINGER_HEIGHT_M + 0.0539)
    assert PandaHanger.workspace_low_m[2] + lowest_finger > 0.05
    assert 0.06 <= panda.CLIP_DROP_M <= 0.08


def test_jacobian_is_the_slope_of_the_pose(world: BulletWorld) -> None:
    hanger = bare_hanger(world, (0.2, 0.2))
    run_step(world, hanger)
    jacobian = hanger._impedance.jacobian
    angles = panda.inverse_kinematics(np.array([0.2, 0.0, 0.2]))
    small = 1e-5
    for joint, axis in enumerate(np.eye(panda.JOINTS)):
        poses = []
        for sign in (1, -1):
            hanger.arm.reset_joints(angles + sign * small * axis)
            poses.append(hanger.arm.tool_pose())
        slope = (poses[0][0] - poses[1][0]) / (2 * small)
        np.testing.assert_allclose(jacobian[:3, joint], slope, atol=1e-4)
        turn = (poses[0][1] - poses[1][1]) @ np.diag([1, -1, -1]) / (2 * small)
        np.testing.assert_allclose(jacobian[3:, joint], [turn[2, 1], turn[0, 2], turn[1, 0]], atol=1e-4)
