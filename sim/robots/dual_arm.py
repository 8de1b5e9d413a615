"""DualArm: two Panda arms, on both sides of the cloth, with a corner in each gripper (section 5-3 of the thesis)."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import ClassVar

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.cloth_frame import NOMINAL_M
from layflat.data.robot import RobotSpec, two_points
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.errors import SimError
from layflat.sim.physics.base import Arm, Cloth, Vector, World
from layflat.sim.robots.arm_shape import ArmShape, ArmSolid, shape_from_urdf
from layflat.sim.robots.base import STIFFNESS_N_M, Control, Robot
from layflat.sim.robots.hand_guiding import HAND_SPEED_M_S, HAND_STIFFNESS_N_M
from layflat.sim.robots.impedance import CartesianImpedance
from layflat.sim.robots.panda import JOINTS, TOOL_M, TORQUE_LIMIT_N_M, inverse_kinematics
from layflat.sim.robots.panda_description import arm_urdf
from layflat.sim.robots.pickers import MAX_SPREAD

BASE_X_M, BASE_Y_M = 0.25, 0.60
"""Where the arms stand: corner 1's at +y, corner 2's at -y, each 0.2 to 0.6 m from where its corner goes."""
YAW_RAD = -math.pi / 2
"""Turn of the first arm's hand, the second's being opposite: fingers along x, so that two hands meet at 7 cm, not 20,
and the last joint stays within 0.15 to 1.7 rad of its middle."""
MAX_LEAD_M = 0.030
"""A set point stays this close to its hand along each axis (12 N of spring): a blocked arm cannot wind up."""
INNER_M, OUTER_M = 0.09, 0.36
"""Distances from the middle plane between which each hand stays: hands never meet, and each arm reaches its corner."""


class DualArm(Robot):
    """Each arm has the thesis's Cartesian impedance of 400 N/m; the six axes are those of the pickers."""

    spec: ClassVar[RobotSpec] = two_points("dual-arm")
    start_step_m: ClassVar[float] = 0.004
    camera_behind = True
    workspace_low_m = (-0.10, -OUTER_M, 0.004)
    workspace_high_m = (0.60, OUTER_M, 0.52)

    def __init__(
        self,
        cloth: Cloth,
        corner_positions: FloatArray,
        *,
        control: Control = "impedance",
        stiffness_n_m: float = STIFFNESS_N_M,
    ) -> None:
        """Put both arms, at rest, where their grippers are at ``corner_positions`` (2, 3) m, row 0 at +y."""
        self._cloth, self._world, self._control, self._stiffness_n_m = cloth, cloth.world, control, stiffness_n_m
        corners = np.array(corner_positions, dtype=float)
        reached = self.within_reach(corners, cloth.spec)
        if np.abs(reached - corners).max() > 1e-9:
            raise SimError(
                f"the arms cannot start at {np.round(corners, 3).tolist()} m; the nearest is "
                f"{np.round(reached, 3).tolist()}"
            )
        self.set_points = corners
        """Where the springs pull the corners now, (2, 3) m, world."""
        self._bases = base_positions_m(cloth.spec)
        self._postures = self._postures_at(corners)
        self._velocity = np.zeros((2, 3))
        self._set_point_step, self._posture_step = np.zeros((2, 3)), np.zeros((2, JOINTS))
        self._posture_speed = np.zeros((2, JOINTS))
        self.arms = [add_gripper_arm(self._world, base) for base in self._bases]
        for arm, posture in zip(self.arms, self._postures, strict=True):
            arm.reset_joints(posture)
        self._laws = [
            CartesianImpedance(arm, self._world.substep_s, stiffness_n_m, yaw_rad=yaw)
            for arm, yaw in zip(self.arms, (YAW_RAD, -YAW_RAD), strict=True)
        ]
        self._holding = False

    def _postures_at(self, corners: FloatArray) -> FloatArray:
        """Return the joint angles (2, 7) rad with the hands straight down at the corners."""
        found = [
            inverse_kinematics(corner, base, yaw_rad=yaw)
            for corner, base, yaw in zip(corners, self._bases, (YAW_RAD, -YAW_RAD), strict=True)
        ]
        return np.array(found)

    def corner_positions(self) -> FloatArray:
        return np.array([arm.tool_pose()[0] for arm in self.arms])

    def position(self) -> FloatArray:
        return self.corner_positions().mean(axis=0)

    def joint_angles(self) -> FloatArray:
        """Return the joint angles of both arms, (14,) rad."""
        return np.concatenate([arm.joint_states()[0] for arm in self.arms])

    def joint_torques(self) -> FloatArray:
        """Return the torques that the impedance gave last, (2, 7) N m."""
        return np.array([law.torque_n_m for law in self._laws])

    def grasp(self) -> None:
        for arm, node in zip(self.arms, self._cloth.spec.corners, strict=True):
            arm.grasp(self._cloth, [node])

    def start_step(self, action: FloatArray, substeps: int) -> None:
        """Add ``action`` (6,) m to the set points, kept in reach and near the real hands."""
        step = np.asarray(action, dtype=float)
        if step.shape != (self.spec.size,) or not np.isfinite(step).all():
            raise SimError(f"the action is {step.tolist()}; it must be six finite numbers, m")
        real = self.corner_positions()
        wanted = np.clip(self.set_points + self.spec.unpack(step), real - MAX_LEAD_M, real + MAX_LEAD_M)
        self._lead(self.within_reach(wanted, self._cloth.spec), substeps)

    def _lead(self, targets: FloatArray, substeps: int) -> None:
        """Move set points and postures evenly to the targets in one step."""
        if self._holding:
            for arm, posture in zip(self.arms, self._postures, strict=True):
                arm.drive_joints(posture, np.zeros(JOINTS), np.zeros(JOINTS))
            self._holding = False
        substep_s = self._world.substep_s
        for law in self._laws:
            law.substep_s = substep_s
        duration = substeps * substep_s
        self._velocity = (targets - self.set_points) / duration
        self._posture_speed = (self._postures_at(targets) - self._postures) / duration
        self._set_point_step, self._posture_step = self._velocity * substep_s, self._posture_speed * substep_s

    def start_guided_step(self, hand_m: FloatArray | None, substeps: int, load_n: float) -> None:
        """Follow a hand on each gripper (2, 3) m as springs of a hand do; an arm without one holds."""
        hands = self.corner_positions() if hand_m is None else np.asarray(hand_m, dtype=float)
        share = HAND_STIFFNESS_N_M / (HAND_STIFFNESS_N_M + self._stiffness_n_m)
        step = (hands - self.set_points) * share
        longest = HAND_SPEED_M_S * substeps * self._world.substep_s
        size = np.linalg.norm(step, axis=-1, keepdims=True)
        step = step * np.minimum(1.0, longest / np.maximum(size, 1e-12))
        self._lead(self.within_reach(self.set_points + step, self._cloth.spec), substeps)

    def before_substep(self) -> None:
        self.set_points = self.set_points + self._set_point_step
        self._postures = self._postures + self._posture_step
        for k, (arm, law) in enumerate(zip(self.arms, self._laws, strict=True)):
            if self._control == "impedance":
                law.apply(self.set_points[k], self._velocity[k], self._postures[k])
            else:
                arm.drive_joints(self._postures[k], self._posture_speed[k], TORQUE_LIMIT_N_M)

    def hold(self) -> None:
        for arm in self.arms:
            arm.drive_joints(np.array(arm.joint_states()[0]), np.zeros(JOINTS), TORQUE_LIMIT_N_M)
        self._holding = True

    @classmethod
    def within_reach(cls, corners: FloatArray, cloth: ClothSpec) -> FloatArray:
        """Return the corners (2, 3) m nearest to the wanted ones that are in reach, apart, and not too far apart."""
        low, high = cls.workspace(cloth)
        wide = np.array([0.0, max(0.0, cloth.width_m - NOMINAL_M) / 2, 0.0])
        inside: FloatArray = np.clip(corners, low - wide, high + wide)
        inside[0, 1], inside[1, 1] = max(inside[0, 1], INNER_M), min(inside[1, 1], -INNER_M)
        apart = inside[0] - inside[1]
        limit, distance = MAX_SPREAD * cloth.width_m, float(np.linalg.norm(apart))
        if distance > limit:
            inside = inside.mean(axis=0) + np.array([0.5, -0.5])[:, None] * apart * (limit / distance)
        return inside


def base_positions_m(cloth: ClothSpec) -> tuple[Vector, Vector]:
    """Return where both arms stand: further out, and on blocks, for a cloth larger than the towel."""
    aside = BASE_Y_M + max(0.0, cloth.width_m - NOMINAL_M) / 2
    x, z = BASE_X_M + cloth.home_x_m, max(0.0, cloth.length_m - NOMINAL_M)
    return (x, aside, z), (x, -aside, z)


def add_gripper_arm(world: World, base_m: Vector) -> Arm:
    """Add an arm whose fingers hold one clip."""
    arm = world.add_arm(_urdf(), base_m, joints=JOINTS, tool_m=TOOL_M)
    world.solids.append(ArmSolid(gripper_shape(base_m), arm))
    return arm


@lru_cache(maxsize=8)
def gripper_shape(base_m: Vector) -> ArmShape:
    """Return the shape of such an arm, to draw it."""
    return shape_from_urdf(_urdf(), base_m, JOINTS)


@lru_cache(maxsize=1)
def _urdf() -> bytes:
    return arm_urdf(0.0)
