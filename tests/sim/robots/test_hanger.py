"""The Panda with its two-clip hanger: reach, description, impedance, and the cloth that it carries."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import pybullet as bullet
import pybullet_data
import pytest

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.spec import HELD_STRETCH, ClothSpec, cloth_spec
from layflat.sim.errors import SimError
from layflat.sim.physics.base import GRAVITY_M_S2
from layflat.sim.physics.bullet.cloth import BulletCloth
from layflat.sim.physics.bullet.world import BulletWorld
from layflat.sim.robots import hanger as module
from layflat.sim.robots import panda, panda_description
from layflat.sim.robots.hanger import PandaHanger

STEP_S = 0.1
WRIST_LINK = panda.JOINTS - 1
START = (0.0, 0.45)
ORIGINAL = os.path.join(pybullet_data.getDataPath(), "franka_panda", "panda.urdf")
STEPS_S = (1 / 200, 1 / 240, 1 / 300)


@pytest.fixture
def world() -> Iterator[BulletWorld]:
    made = BulletWorld(substep_s=1 / 240, table_friction=1.0)
    yield made
    made.close()


def corners_at(spec: ClothSpec, x: float, z: float) -> FloatArray:
    half = 0.5 * HELD_STRETCH * spec.width_m
    return np.array([[x, half, z], [x, -half, z]])


def bare_hanger(
    world: BulletWorld, start: tuple[float, float] = START, cloth: str = "towel", **options: str
) -> PandaHanger:
    """A hanger that holds nothing, so that it costs microseconds a substep."""
    spec = cloth_spec(cloth)
    holder = SimpleNamespace(world=world, spec=spec)
    return PandaHanger(holder, corners_at(spec, *start), **options)  # type: ignore[arg-type]


def run_step(
    world: BulletWorld,
    hanger: PandaHanger,
    action: tuple[float, float] = (0.0, 0.0),
    push_n: tuple[float, float, float] = (0, 0, 0),
) -> FloatArray:
    """One step; returns the largest torque of each joint (7,) N m."""
    substeps = round(STEP_S / world.substep_s)
    hanger.start_step(np.array(action), substeps)
    largest = np.zeros(panda.JOINTS)
    for _ in range(substeps):
        hanger.before_substep()
        largest = np.maximum(largest, np.abs(hanger.joint_torques()))
        if any(push_n):
            place = hanger.position().tolist()
            bullet.applyExternalForce(
                hanger.arm.body, WRIST_LINK, push_n, place, bullet.WORLD_FRAME, physicsClientId=world.client
            )
        world.step()
    return largest


def arm_of(world: BulletWorld, clip_distance_m: float) -> int:
    urdf = panda_description.arm_urdf(clip_distance_m)
    return world.add_arm(urdf, panda.BASE_POSITION_M, joints=panda.JOINTS, tool_m=panda.TOOL_M).body


def set_joints(world: BulletWorld, arm: int, angles: FloatArray) -> None:
    for joint, angle in enumerate(angles):
        bullet.resetJointState(arm, joint, float(angle), 0.0, physicsClientId=world.client)


class TestDescription:
    def test_constants_are_those_of_the_original(self) -> None:
        joints = {j.get("name"): j for j in ET.parse(ORIGINAL).getroot().findall("joint")}
        arm = [joints[f"panda_joint{i}"] for i in range(1, 8)]
        assert [float(j.find("limit").get("effort")) for j in arm] == panda.TORQUE_LIMIT_N_M.tolist()
        soft = [j.find("safety_controller") for j in arm]
        assert [float(s.get("soft_lower_limit")) for s in soft] == panda.JOINT_LOW_RAD.tolist()
        assert [float(s.get("soft_upper_limit")) for s in soft] == panda.JOINT_HIGH_RAD.tolist()
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

    def test_masses_and_centre_of_mass_are_the_originals_plus_the_hanger(self, world: BulletWorld) -> None:
        """The wrist merged into one link keeps its mass and its centre: the original, loaded as it is, is the judge."""
        client = world.client
        original = bullet.loadURDF(
            ORIGINAL,
            panda.BASE_POSITION_M,
            useFixedBase=True,
            flags=bullet.URDF_IGNORE_VISUAL_SHAPES,
            physicsClientId=client,
        )
        ours = arm_of(world, 0.36)
        angles = panda.inverse_kinematics(np.array([0.0, 0.0, 0.4]))
        set_joints(world, ours, angles)
        set_joints(world, original, angles)
        links = range(bullet.getNumJoints(original, physicsClientId=client))
        masses = [bullet.getDynamicsInfo(original, i, physicsClientId=client)[0] for i in links]
        places = [
            np.array(bullet.getLinkState(original, i, computeForwardKinematics=1, physicsClientId=client)[0])
            for i in links
        ]
        for i in range(panda.JOINTS - 1):
            assert bullet.getDynamicsInfo(ours, i, physicsClientId=client)[0] == masses[i]
        added = panda_description.BAR_MASS_KG + 2 * panda_description.CLIP_MASS_KG
        assert 0.15 <= added <= 0.25
        wrist = bullet.getDynamicsInfo(ours, WRIST_LINK, physicsClientId=client)
        assert wrist[0] == pytest.approx(sum(masses[6:]) + added)
        # The hand points down: bar and clips hang at known heights above the corners.
        hanging = [
            (panda_description.BAR_MASS_KG, panda.CLIP_DROP_M),
            (2 * panda_description.CLIP_MASS_KG, panda.CLIP_DROP_M / 2),
        ]
        hanging = [(mass, np.array([0.0, 0.0, 0.4 + up])) for mass, up in hanging]
        moment = sum(m * p for m, p in [*zip(masses[6:], places[6:], strict=True), *hanging])
        state = bullet.getLinkState(ours, WRIST_LINK, computeForwardKinematics=1, physicsClientId=client)
        np.testing.assert_allclose(state[0], moment / wrist[0], atol=1e-6)

    @pytest.mark.parametrize("distance", [0.2, 0.36])
    def test_inertias_belong_to_real_bodies(self, world: BulletWorld, distance: float) -> None:
        arm = arm_of(world, distance)
        for link in range(panda.JOINTS):
            x, y, z = bullet.getDynamicsInfo(arm, link, physicsClientId=world.client)[2]
            assert min(x, y, z) > 0
            assert x + y >= z
            assert y + z >= x
            assert x + z >= y

    def test_a_wider_hanger_is_harder_to_turn(self, world: BulletWorld) -> None:
        """Two clips and a bar of length l further out: the difference is that of point masses and rods, by hand."""
        inertia = [
            np.array(bullet.getDynamicsInfo(arm_of(world, d), 6, physicsClientId=world.client)[2]) for d in (0.2, 0.4)
        ]
        clips = 2 * panda_description.CLIP_MASS_KG * (0.2**2 - 0.1**2)
        width = panda_description.CLIP_SIZE_M[1]
        bar = panda_description.BAR_MASS_KG / 12 * ((0.4 + width) ** 2 - (0.2 + width) ** 2)
        np.testing.assert_allclose(inertia[1] - inertia[0], [clips + bar, 0.0, clips + bar], atol=1e-9)

    def test_it_touches_nothing(self, world: BulletWorld) -> None:
        arm = arm_of(world, 0.36)
        for link in range(-1, panda.JOINTS):
            assert not bullet.getCollisionShapeData(arm, link, physicsClientId=world.client)

    def test_bad_distance_is_refused(self) -> None:
        with pytest.raises(SimError, match="apart"):
            panda_description.arm_urdf(float("nan"))


class TestReach:
    def test_whole_workspace_hand_down_with_margin(self, world: BulletWorld) -> None:
        hanger = bare_hanger(world)
        for x in np.linspace(PandaHanger.workspace_low_m[0], PandaHanger.workspace_high_m[0], 8):
            for z in np.linspace(PandaHanger.workspace_low_m[2], PandaHanger.workspace_high_m[2], 7):
                for y in (-module.MAX_SIDE_M, module.MAX_SIDE_M):
                    angles = panda.inverse_kinematics(np.array([x, y, z]))
                    assert np.minimum(angles - panda.JOINT_LOW_RAD, panda.JOINT_HIGH_RAD - angles).min() > 0.25
                    # The elbow never comes near straight (about -0.47 rad), where the arm could not yield outwards.
                    assert angles[3] < -0.9
                    set_joints(world, hanger.arm.body, angles)
                    place, rotation = hanger.arm.tool_pose()
                    np.testing.assert_allclose(place, [x, y, z], atol=1e-6)
                    np.testing.assert_allclose(rotation, np.diag([1, -1, -1]), atol=1e-6)

    def test_out_of_reach_is_refused(self) -> None:
        with pytest.raises(SimError, match="cannot reach"):
            panda.inverse_kinematics(np.array([1.6, 0.0, 0.3]))

    def test_bar_and_fingers_stay_above_the_table(self) -> None:
        lowest_finger = panda.CLIP_DROP_M + panda.GRIP_DEPTH_M - (panda_description.FINGER_HEIGHT_M + 0.0539)
        assert PandaHanger.workspace_low_m[2] + lowest_finger > 0.05
        assert 0.06 <= panda.CLIP_DROP_M <= 0.08

    def test_jacobian_is_the_slope_of_the_pose(self, world: BulletWorld) -> None:
        hanger = bare_hanger(world, (0.2, 0.2))
        run_step(world, hanger)
        jacobian = hanger._impedance.jacobian
        angles = panda.inverse_kinematics(np.array([0.2, 0.0, 0.2]))
        small = 1e-5
        for joint, axis in enumerate(np.eye(panda.JOINTS)):
            poses = []
            for sign in (1, -1):
                set_joints(world, hanger.arm.body, angles + sign * small * axis)
                poses.append(hanger.arm.tool_pose())
            slope = (poses[0][0] - poses[1][0]) / (2 * small)
            np.testing.assert_allclose(jacobian[:3, joint], slope, atol=1e-4)
            turn = (poses[0][1] - poses[1][1]) @ np.diag([1, -1, -1]) / (2 * small)
            np.testing.assert_allclose(jacobian[3:, joint], [turn[2, 1], turn[0, 2], turn[1, 0]], atol=1e-4)


class TestStart:
    @pytest.mark.parametrize("cloth", ["towel", "napkin"])
    @pytest.mark.parametrize("start", [START, (-0.1, 0.55), (0.6, 0.004), (0.3, 0.2)])
    def test_clips_are_at_the_corners(self, world: BulletWorld, cloth: str, start: tuple[float, float]) -> None:
        hanger = bare_hanger(world, start, cloth)
        wanted = corners_at(cloth_spec(cloth), *start)
        np.testing.assert_allclose(hanger.corner_positions(), wanted, atol=1e-4)
        np.testing.assert_allclose(hanger.position(), wanted.mean(axis=0), atol=1e-4)

    def test_corners_that_do_not_fit_are_refused(self, world: BulletWorld) -> None:
        spec = cloth_spec("towel")
        holder = SimpleNamespace(world=world, spec=spec)
        good = corners_at(spec, *START)
        for bad in (good[::-1], good * [1, 0.9, 1], np.add(good, [[0, 0, 0.01], [0, 0, 0]])):
            with pytest.raises(SimError, match="do not fit"):
                PandaHanger(holder, bad)  # type: ignore[arg-type]
        for away in ([0.7, 0, 0], [0, 0, 0.3], [0, 0.1, 0]):
            with pytest.raises(SimError, match="cannot start"):
                PandaHanger(holder, good + away)  # type: ignore[arg-type]
        with pytest.raises(SimError, match="control"):
            PandaHanger(holder, good, control="magic")  # type: ignore[arg-type]

    def test_bad_actions_are_refused(self, world: BulletWorld) -> None:
        hanger = bare_hanger(world)
        for bad in (np.array([np.nan, 0.0]), np.zeros(6)):
            with pytest.raises(SimError, match="two finite numbers"):
                hanger.start_step(bad, 24)


class TestImpedance:
    @pytest.mark.parametrize("substep_s", STEPS_S)
    def test_holds_still(self, substep_s: float) -> None:
        world = BulletWorld(substep_s=substep_s, table_friction=1.0)
        try:
            hanger = bare_hanger(world)
            start = hanger.position()
            for _ in range(50):
                torques = run_step(world, hanger)
                assert np.abs(hanger.position() - start).max() < 1e-5
                assert (torques < panda.TORQUE_LIMIT_N_M).all()
        finally:
            world.close()

    @pytest.mark.parametrize("axis", [0, 1, 2])
    @pytest.mark.parametrize("start", [START, (0.35, 0.02)])
    def test_stiffness_is_400_n_per_m(self, world: BulletWorld, axis: int, start: tuple[float, float]) -> None:
        hanger = bare_hanger(world, start)
        push = np.zeros(3)
        push[axis] = 4.0
        before = hanger.position()
        for _ in range(20):
            run_step(world, hanger, push_n=tuple(push))
        np.testing.assert_allclose(hanger.position() - before, push / 400.0, atol=2e-4)
        np.testing.assert_allclose(hanger.spring_force_n(), -push, atol=0.1)

    def test_critically_damped(self, world: BulletWorld) -> None:
        """Let go of a push, it comes back without passing the set point by more than a hair."""
        hanger = bare_hanger(world)
        start = hanger.position()[0]
        for _ in range(20):
            run_step(world, hanger, push_n=(4.0, 0.0, 0.0))
        path = []
        for _ in range(240):
            hanger.before_substep()
            world.step()
            path.append(hanger.position()[0] - start)
        assert min(path) > -0.0005
        assert abs(path[-1]) < 0.0002
        # Not sluggish either: half the way within a quarter of a second.
        assert path[60] < 0.005

    @pytest.mark.parametrize("action", [(0.01, 0.0), (0.0, -0.01), (0.007, -0.007)])
    def test_follows_ten_millimetres_a_step(self, world: BulletWorld, action: tuple[float, float]) -> None:
        hanger = bare_hanger(world)
        for step_index in range(30):
            torques = run_step(world, hanger, action)
            lag = np.linalg.norm(hanger.position() - hanger.set_point())
            assert lag < (0.004 if step_index < 5 else 0.0015)
            left, right = hanger.corner_positions()
            assert abs(left[2] - right[2]) < 0.001
            assert abs(left[0] - right[0]) < 0.001
            assert (torques < panda.TORQUE_LIMIT_N_M).all()
        for _ in range(10):
            run_step(world, hanger)
        np.testing.assert_allclose(hanger.position()[[0, 2]], np.add(START, np.multiply(30, action)), atol=2e-4)

    @pytest.mark.parametrize("substep_s", STEPS_S)
    def test_shaking_with_the_largest_actions_stays_stable(self, substep_s: float) -> None:
        world = BulletWorld(substep_s=substep_s, table_friction=1.0)
        try:
            hanger = bare_hanger(world, (0.25, 0.3))
            rng = np.random.default_rng(1)
            for _ in range(40):
                torques = run_step(world, hanger, tuple(rng.uniform(-0.02, 0.02, 2)))
                assert (torques < panda.TORQUE_LIMIT_N_M).all()
                assert np.linalg.norm(hanger.position() - hanger.set_point()) < module.MAX_LEAD_M
            for _ in range(15):
                run_step(world, hanger)
            assert np.linalg.norm(hanger.position() - hanger.set_point()) < 1e-3
        finally:
            world.close()

    def test_torques_never_pass_the_limits(self, world: BulletWorld) -> None:
        hanger = bare_hanger(world)
        largest = np.zeros(panda.JOINTS)
        for _ in range(5):
            largest = np.maximum(largest, run_step(world, hanger, push_n=(150.0, 0.0, -150.0)))
        assert (largest <= panda.TORQUE_LIMIT_N_M).all()
        assert (largest == panda.TORQUE_LIMIT_N_M).any()
        assert np.isfinite(hanger.position()).all()

    def test_sideways_gravity_is_compensated(self, world: BulletWorld) -> None:
        """Wind on the cloth is made from gravity; it must not blow the arm away."""
        hanger = bare_hanger(world)
        start = hanger.position()
        world.set_gravity((1.5, -1.0, -GRAVITY_M_S2))
        for _ in range(10):
            run_step(world, hanger)
        assert np.abs(hanger.position() - start).max() < 0.001


class TestSetPoint:
    def test_actions_add_up_without_drift(self, world: BulletWorld) -> None:
        hanger = bare_hanger(world)
        start = hanger.set_point()
        for action in [(0.01, -0.005)] * 10 + [(-0.01, 0.005)] * 10:
            run_step(world, hanger, action)
        np.testing.assert_allclose(hanger.set_point(), start, atol=1e-9)

    def test_stays_in_the_workspace(self, world: BulletWorld) -> None:
        hanger = bare_hanger(world, (0.58, 0.02))
        for _ in range(5):
            run_step(world, hanger, (0.02, -0.02))
        np.testing.assert_allclose(hanger.set_point()[[0, 2]], [0.60, 0.004], atol=1e-9)

    def test_a_blocked_arm_does_not_wind_up(self, world: BulletWorld) -> None:
        """Against a wall (a stiff spring one centimetre ahead) the pull stays that of the lead, and ends at once."""
        hanger = bare_hanger(world)
        start = hanger.position()[0]
        for _ in range(25):
            hanger.start_step(np.array([0.01, 0.0]), 24)
            for _ in range(24):
                hanger.before_substep()
                place = hanger.position()
                wall = (-4000.0 * max(place[0] - start - 0.01, 0.0), 0.0, 0.0)
                bullet.applyExternalForce(
                    hanger.arm.body, WRIST_LINK, wall, place.tolist(), bullet.WORLD_FRAME, physicsClientId=world.client
                )
                world.step()
        assert hanger.position()[0] - start < 0.015
        assert 0.02 < hanger.set_point()[0] - hanger.position()[0] < module.MAX_LEAD_M + 1e-3
        for _ in range(4):
            run_step(world, hanger, (-0.01, 0.0))
        assert hanger.set_point()[0] < start + 0.01


class TestPositionControl:
    def test_follows_and_does_not_yield(self, world: BulletWorld) -> None:
        hanger = bare_hanger(world, control="position")
        for _ in range(10):
            run_step(world, hanger, (0.01, -0.01))
        np.testing.assert_allclose(hanger.position()[[0, 2]], np.add(START, (0.1, -0.1)), atol=1e-3)
        before = hanger.position()
        for _ in range(5):
            torques = run_step(world, hanger, push_n=(4.0, 0.0, 0.0))
        assert np.linalg.norm(hanger.position() - before) < 0.001
        assert (torques <= panda.TORQUE_LIMIT_N_M + 1e-9).all()
        with pytest.raises(SimError, match="springs"):
            hanger.spring_force_n()


def gripped(world: BulletWorld, name: str, hem_m: float = 0.0, top_m: float = 0.1) -> tuple[BulletCloth, PandaHanger]:
    """A cloth in the clips, its lower edge ``top_m`` above the table and all but its corners ``hem_m`` along x."""
    spec = cloth_spec(name)
    cloth = world.add_cloth(spec)
    hanger = PandaHanger(cloth, corners_at(spec, 0.0, spec.length_m + top_m))
    nodes = spec.hanging_nodes(hanger.corner_positions())
    free = np.setdiff1d(np.arange(len(nodes)), spec.corners)
    nodes[free, 0] += hem_m
    cloth.set_nodes(nodes)
    hanger.grasp()
    return cloth, hanger


class TestWithCloth:
    def test_carries_a_towel(self, world: BulletWorld) -> None:
        """It sags by weight / stiffness, level, and the clips keep their corners, each its own."""
        cloth, hanger = gripped(world, "towel")
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
    def test_lays_it_flat(self, name: str, hem_m: float) -> None:
        """Whole placement, whichever side the hem has flopped to; x starts before the free edge touches."""
        spec = cloth_spec(name)
        world = BulletWorld(substep_s=1 / spec.rate_hz, table_friction=1.0)
        try:
            cloth, hanger = gripped(world, name, hem_m)
            for _ in range(20):
                run_step(world, hanger)
            while cloth.nodes()[:, 2].min() > 0.04:
                run_step(world, hanger, (0.0, -0.01))
            while hanger.position()[2] > 0.0065:
                run_step(world, hanger, (0.0095, -0.01))
            for _ in range(10):
                run_step(world, hanger, (0.005, 0.0))
            for _ in range(10):
                run_step(world, hanger)
            nodes = cloth.nodes()
            assert cloth.divergence_reason(nodes) is None
            assert cloth.flat_area(nodes) > 0.95
            assert cloth.contact_portion_true(nodes) > 0.95
        finally:
            world.close()
