"""BulletArm: a robot arm as a multibody with a fixed base."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pybullet as bullet

from layflat.data.arrays import FloatArray
from layflat.sim.physics.base import Cloth, Vector
from layflat.sim.physics.bullet.cloth import bullet_cloth, temporary_file

POSITION_GAIN = 0.3
"""Share of a joint's error that a stiff motor takes back in one substep."""


class BulletArm:
    """An arm whose joints 0 to J - 1 lead to its last link, which holds the tool."""

    def __init__(self, client: int, urdf: bytes, base_position_m: Vector, joints: int, tool_m: float) -> None:
        self._client = client
        self._tool_m = tool_m
        self._tip = [0.0, 0.0, tool_m]
        self._wrist = joints - 1
        self._joints = list(range(joints))
        self._zeros = [0.0] * joints
        self.body = self._load(urdf, base_position_m)

    def _load(self, urdf: bytes, base_position_m: Vector) -> int:
        client = self._client
        with temporary_file(".urdf", urdf) as path:
            flags = bullet.URDF_USE_INERTIA_FROM_FILE | bullet.URDF_IGNORE_VISUAL_SHAPES
            arm = bullet.loadURDF(path, base_position_m, useFixedBase=True, flags=flags, physicsClientId=client)
        for link in (-1, *self._joints):
            # Bullet damps every multibody a little by default, which would add to the impedance.
            bullet.changeDynamics(
                arm,
                link,
                linearDamping=0.0,
                angularDamping=0.0,
                jointDamping=0.0,
                activationState=bullet.ACTIVATION_STATE_DISABLE_SLEEPING,
                physicsClientId=client,
            )
        # Without this a velocity motor at rest brakes each joint.
        bullet.setJointMotorControlArray(
            arm, self._joints, bullet.VELOCITY_CONTROL, forces=self._zeros, physicsClientId=client
        )
        return int(arm)

    def reset_joints(self, angles: FloatArray) -> None:
        for joint, angle in enumerate(angles):
            bullet.resetJointState(self.body, joint, float(angle), 0.0, physicsClientId=self._client)

    def joint_states(self) -> tuple[list[float], list[float]]:
        states = bullet.getJointStates(self.body, self._joints, physicsClientId=self._client)
        return [s[0] for s in states], [s[1] for s in states]

    def set_torques(self, torques_n_m: FloatArray) -> None:
        bullet.setJointMotorControlArray(
            self.body, self._joints, bullet.TORQUE_CONTROL, forces=torques_n_m.tolist(), physicsClientId=self._client
        )

    def drive_joints(self, angles: FloatArray, speeds: FloatArray, torque_limits_n_m: FloatArray) -> None:
        bullet.setJointMotorControlArray(
            self.body,
            self._joints,
            bullet.POSITION_CONTROL,
            targetPositions=angles.tolist(),
            targetVelocities=speeds.tolist(),
            forces=torque_limits_n_m.tolist(),
            positionGains=[POSITION_GAIN] * len(self._joints),
            velocityGains=[1.0] * len(self._joints),
            physicsClientId=self._client,
        )

    def tool_pose(self) -> tuple[FloatArray, FloatArray]:
        state = bullet.getLinkState(self.body, self._wrist, computeForwardKinematics=1, physicsClientId=self._client)
        # The link's inertial frame is turned like the tool and lies on its axis.
        rotation = np.array(bullet.getMatrixFromQuaternion(state[1])).reshape(3, 3)
        return np.array(state[0]) + rotation[:, 2] * (self._tool_m - state[2][2]), rotation

    def push_tool(self, force_n: FloatArray, position_m: FloatArray) -> None:
        force, place = force_n.tolist(), position_m.tolist()
        bullet.applyExternalForce(
            self.body, self._wrist, force, place, bullet.WORLD_FRAME, physicsClientId=self._client
        )

    def dynamics(
        self, angles: list[float], speeds: list[float]
    ) -> tuple[Sequence[Sequence[float]], Sequence[Sequence[float]], FloatArray, Sequence[float]]:
        arm, client, zeros = self.body, self._client, self._zeros
        linear, angular = bullet.calculateJacobian(
            arm, self._wrist, self._tip, angles, zeros, zeros, physicsClientId=client
        )
        inertia = np.array(bullet.calculateMassMatrix(arm, angles, physicsClientId=client))
        bias = bullet.calculateInverseDynamics(arm, angles, speeds, zeros, physicsClientId=client)
        return linear, angular, inertia, bias

    def grasp(self, cloth: Cloth, nodes: Sequence[int]) -> None:
        # All anchors sit on the last link; each keeps the offset at which its node is now.
        for node in nodes:
            bullet_cloth(cloth).anchor(node, self.body, self._wrist)
