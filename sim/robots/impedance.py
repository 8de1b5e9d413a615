"""Cartesian impedance of the hanger: springs and dampers on the set point, as torques of a redundant arm."""

from __future__ import annotations

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.sim.physics.base import Arm
from layflat.sim.robots.panda import JOINTS, TORQUE_LIMIT_N_M

ROTATIONAL_STIFFNESS_N_M_RAD = 60.0
"""Keeps the bar level: half a towel's weight on one clip only (0.25 N at 0.18 m) tilts it by 0.75 mrad."""
DAMPING_RATIO = 1.0
POSTURE_STIFFNESS_N_M_RAD = 10.0
"""Stiffness of the one motion that leaves the hanger where it is (the elbow going round)."""
COMPLIANT_DAMPING_N_S_M = 12.0
"""Damping along x and z while the arm yields: a hand feels 0.6 N of it at 5 cm/s."""
REFRESH_SUBSTEPS = 12
"""Substeps between two computations of Jacobian, inertia and gravity; springs and dampers see fresh joints in each.

Taken half way ahead they are as good as fresh ones: 10 and 20 mm steps lag the same with 1, 12 and 24."""

_KEPT = np.array([0.0, 1.0, 0.0, 1.0, 1.0, 1.0])
"""Share of stiffness and damping that remains while the arm yields: y and the rotations."""
_COMPLIANT_DAMPING = np.diag(COMPLIANT_DAMPING_N_S_M * np.array([1.0, 0.0, 1.0, 0.0, 0.0, 0.0]))
_ELBOW_DAMPING = 2.0 * np.sqrt(POSTURE_STIFFNESS_N_M_RAD)
"""Critical damping / root of the inertia."""
_TORQUE_LOW_N_M = -TORQUE_LIMIT_N_M
_IDENTITY = np.eye(JOINTS)
_DOWN = np.diag([1.0, -1.0, -1.0])
"""The hand's axes in the world when it points straight down: its y is the bar, towards -y."""


class CartesianImpedance:
    """The torque law tau = J^T (K e + D e') + N (posture) + gravity and Coriolis torques.

    e: (6,) position and rotation from where the hanger is to its set point; K diagonal; D = S sqrt(K) + sqrt(K) S with
    S = sqrt(Lambda), which is critical damping for the operational-space inertia Lambda (Albu-Schaeffer et al. 2003);
    N: torques that do not accelerate the hanger (dynamically consistent null space).

    e' is taken against the set point's own speed, so a steady move hardly lags. Between two refreshes the
    law is linear in joint angles, joint speeds, set point and its speed: a substep costs one product with a (7, 20)
    matrix, and as the angles move by a few milliradians, the second-order error is micrometres.
    """

    def __init__(self, arm: Arm, substep_s: float, stiffness_n_m: float, *, yaw_rad: float = 0.0) -> None:
        """Make the law with that translational stiffness, and the hand turned about z by ``yaw_rad``."""
        cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
        turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        self._attitude = turn @ _DOWN if yaw_rad else _DOWN
        self._arm = arm
        self._stiffness = np.array([stiffness_n_m] * 3 + [ROTATIONAL_STIFFNESS_N_M_RAD] * 3)
        self.substep_s = substep_s
        """Duration of the coming substeps."""
        self._gain = np.zeros((JOINTS, 2 * JOINTS + 6))
        self._offset = np.zeros(JOINTS)
        self._input = np.zeros(2 * JOINTS + 6)
        self.torque_n_m = np.zeros(JOINTS)
        """Torques of the last substep, (7,) N m."""
        self._age = REFRESH_SUBSTEPS
        self._compliant = False
        self.jacobian = np.zeros((6, JOINTS))
        """Jacobian of the corners' midpoint at the last refresh: m/rad above, rotation below."""

    def yield_in_plane(self, compliant: bool) -> None:
        """Switch off the springs along x and z and most of the damping, or (False) switch both on again."""
        if compliant != self._compliant:
            self._compliant = compliant
            self._age = REFRESH_SUBSTEPS

    def apply(
        self, set_point: FloatArray, velocity: FloatArray, posture: FloatArray, force: FloatArray | None = None
    ) -> None:
        """Apply the torques of this substep, and exert ``force`` (3,) N, world, at the corners' midpoint besides.

        ``set_point`` (3,) m and ``velocity`` (3,) m/s are the midpoint's, world; ``posture`` (7,) rad.
        """
        angles, speeds = self._arm.joint_states()
        if self._age >= REFRESH_SUBSTEPS:
            self._refresh(angles, speeds, posture)
            self._age = 0
        self._age += 1
        self._input[: 2 * JOINTS] = angles + speeds
        self._input[2 * JOINTS : 2 * JOINTS + 3] = set_point
        self._input[2 * JOINTS + 3 :] = velocity
        torque = self.torque_n_m
        np.matmul(self._gain, self._input, out=torque)
        torque += self._offset
        if force is not None:
            torque += self.jacobian[:3].T @ force
        np.minimum(torque, TORQUE_LIMIT_N_M, out=torque)
        np.maximum(torque, _TORQUE_LOW_N_M, out=torque)
        self._arm.set_torques(torque)

    def _refresh(self, angles: list[float], speeds: list[float], posture: FloatArray) -> None:
        """Linearise the law about the joint angles half way to the next refresh."""
        ahead = 0.5 * REFRESH_SUBSTEPS * self.substep_s
        middle = [angle + ahead * speed for angle, speed in zip(angles, speeds, strict=True)]
        jacobian = self.jacobian
        jacobian[:3], jacobian[3:], inertia, bias = self._arm.dynamics(middle, speeds)
        place, rotation = self._arm.tool_pose()

        inverse = np.linalg.inv(inertia)
        to_acceleration = inverse @ jacobian.T
        task_inertia: FloatArray = np.linalg.inv(jacobian @ to_acceleration).astype(float, copy=False)
        null_space = _IDENTITY - jacobian.T @ task_inertia @ to_acceleration.T
        damping = _critical_damping(task_inertia, self._stiffness)
        elbow_damping = _ELBOW_DAMPING * _root(inertia)

        stiffness = self._stiffness
        if self._compliant:
            # Kept apart: a product of both would not be positive any more, and would drive the arm.
            stiffness, damping = stiffness * _KEPT, _COMPLIANT_DAMPING + _KEPT[:, None] * damping * _KEPT
        spring, damper = jacobian.T * stiffness, jacobian.T @ damping
        # Error at angles q: error0 - J (q - angles), with set point and posture added by the caller's values.
        constant = np.concatenate([-place, _rotation_error(rotation, self._attitude)]) + jacobian @ np.array(angles)
        gain = self._gain
        gain[:, :JOINTS] = -spring @ jacobian - POSTURE_STIFFNESS_N_M_RAD * null_space
        gain[:, JOINTS : 2 * JOINTS] = -damper @ jacobian - null_space @ elbow_damping
        gain[:, 2 * JOINTS : 2 * JOINTS + 3] = spring[:, :3]
        gain[:, 2 * JOINTS + 3 :] = damper[:, :3]
        self._offset = spring @ constant + POSTURE_STIFFNESS_N_M_RAD * (null_space @ posture) + bias


def _rotation_error(rotation: FloatArray, attitude: FloatArray) -> FloatArray:
    """Return the small rotation from ``rotation`` to ``attitude`` (3, 3), (3,) rad, world."""
    # Half the sum of the cross products of present and wanted axes.
    skew = attitude @ rotation.T
    skew = skew - skew.T
    return 0.5 * np.array([skew[2, 1], skew[0, 2], skew[1, 0]])


def _critical_damping(task_inertia: FloatArray, stiffness: FloatArray) -> FloatArray:
    root, springs = _root(task_inertia), np.sqrt(stiffness)
    return DAMPING_RATIO * (root * springs + springs[:, None] * root)


def _root(matrix: FloatArray) -> FloatArray:
    """Return the square root of a symmetric positive matrix."""
    values, vectors = np.linalg.eigh(matrix)
    return (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
