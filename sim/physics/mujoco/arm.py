"""MujocoArm: a chain of bodies; its kinematics and dynamics come from a small model of the arm alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from layflat.data.arrays import FloatArray
from layflat.sim.physics.base import Cloth, Vector
from layflat.sim.physics.mujoco.engine import Engine
from layflat.sim.physics.mujoco.model_text import arm_text, world_text

POSITION_GAIN = 0.3
"""Share of a joint's error that a stiff motor takes back in one substep."""


class MujocoArm:
    """An arm whose last body, "tool", holds the tool."""

    def __init__(self, engine: Engine, urdf: bytes, base_position_m: Vector, joints: int, tool_m: float) -> None:
        self._engine, self._joints, self._tool_m = engine, joints, tool_m
        self.text = arm_text(urdf, base_position_m, joints)
        text = world_text(parts=[self.text], table_friction=1.0, points=(), held=())
        self._model: Any = mujoco.MjModel.from_xml_string(text)
        self._scratch: Any = mujoco.MjData(self._model)
        self._tool = self._model.body("tool").id
        self._angles: Any = np.zeros(joints)
        self._speeds: Any = np.zeros(joints)
        self._dofs = slice(0, 0)
        self._torques = np.zeros(joints)
        """Torques of the coming substep, N m."""

    def __deepcopy__(self, memo: object) -> MujocoArm:
        return self

    def enter(self, model: Any, data: Any) -> None:
        joint = model.joint("arm1")
        first, dof = int(joint.qposadr[0]), int(joint.dofadr[0])
        data.qpos[first : first + self._joints] = self._angles
        data.qvel[dof : dof + self._joints] = self._speeds
        self._dofs = slice(dof, dof + self._joints)
        self._angles, self._speeds = data.qpos[first : first + self._joints], data.qvel[self._dofs]

    def apply_forces(self, data: Any) -> None:
        data.qfrc_applied[self._dofs] = self._torques + self._motor_torques()
        self._torques[:] = 0.0

    def _motor_torques(self) -> FloatArray:
        """Return the torques that bring the joints to their motors' speeds in one substep, within the limits."""
        motors = self._engine.holds.motors
        if motors is None:
            return np.zeros(self._joints)
        angles, speeds, limits = motors
        substep_s = self._engine.substep_s
        wanted = speeds + POSITION_GAIN * (angles - self._angles) / substep_s
        _, _, inertia, bias = self.dynamics(self._angles, self._speeds)
        return np.clip(inertia @ (wanted - self._speeds) / substep_s + bias, -limits, limits)

    def reset_joints(self, angles: FloatArray) -> None:
        self._angles[:], self._speeds[:] = angles, 0.0

    def joint_states(self) -> tuple[list[float], list[float]]:
        return self._angles.tolist(), self._speeds.tolist()

    def set_torques(self, torques_n_m: FloatArray) -> None:
        self._torques += torques_n_m

    def drive_joints(self, angles: FloatArray, speeds: FloatArray, torque_limits_n_m: FloatArray) -> None:
        on = bool(np.any(torque_limits_n_m))
        self._engine.holds.motors = (angles.copy(), speeds.copy(), torque_limits_n_m.copy()) if on else None

    def _place(self, angles: Any) -> tuple[FloatArray, FloatArray]:
        """Put the small model there; return the tool's position and axes."""
        data = self._scratch
        data.qpos[:] = angles
        mujoco.mj_kinematics(self._model, data)
        rotation = data.ximat[self._tool].reshape(3, 3).copy()  # its inertial frame is turned like the tool
        return data.xpos[self._tool] + self._tool_m * rotation[:, 2], rotation

    def tool_pose(self) -> tuple[FloatArray, FloatArray]:
        return self._place(self._angles)

    def push_tool(self, force_n: FloatArray, position_m: FloatArray) -> None:
        self._place(self._angles)
        mujoco.mj_comPos(self._model, self._scratch)
        jacobian = np.zeros((3, self._joints))
        mujoco.mj_jac(self._model, self._scratch, jacobian, None, position_m, self._tool)
        self._torques += jacobian.T @ force_n

    def dynamics(
        self, angles: Any, speeds: Any
    ) -> tuple[Sequence[Sequence[float]], Sequence[Sequence[float]], FloatArray, Sequence[float]]:
        model, data = self._model, self._scratch
        model.opt.gravity[:] = self._engine.gravity_m_s2
        tip, _ = self._place(angles)
        data.qvel[:] = speeds
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        linear, angular = np.zeros((3, self._joints)), np.zeros((3, self._joints))
        mujoco.mj_jac(model, data, linear, angular, tip, self._tool)
        inertia = np.zeros((self._joints, self._joints))
        mujoco.mj_fullM(model, data, inertia)
        return linear, angular, inertia, data.qfrc_bias.copy()  # type: ignore[return-value]  # arrays are sequences

    def grasp(self, cloth: Cloth, nodes: Sequence[int]) -> None:
        self._place(self._angles)
        position, rotation = self._scratch.xpos[self._tool], self._scratch.xmat[self._tool].reshape(3, 3)
        places = (cloth.nodes()[list(nodes)] - position) @ rotation
        self._engine.holds.tool_nodes |= dict(zip(map(int, nodes), places.tolist(), strict=True))
        self._engine.changed()
