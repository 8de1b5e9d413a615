"""A Panda arm with a two-clip hanger that carries the cloth's corners in x and z (chapters 3-3-1 and 4-3)."""

from __future__ import annotations

from typing import ClassVar, get_args

import numpy as np
import pybullet as bullet

from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec, one_point
from layflat.sim.cloth.cloth import HELD_STRETCH, Cloth
from layflat.sim.errors import SimError
from layflat.sim.robots.base import Control
from layflat.sim.robots.hand_guiding import WALL_STIFFNESS_N_M, HandGuiding
from layflat.sim.robots.impedance import STIFFNESS_N_M, CartesianImpedance, hanger_pose
from layflat.sim.robots.panda import JOINTS, TORQUE_LIMIT_N_M, WRIST_LINK, inverse_kinematics, load_arm

WORKSPACE_LOW_M = np.array([-0.10, 0.004])
"""x and z of the corners' set point; z is the height at which cloth rests."""
WORKSPACE_HIGH_M = np.array([0.60, 0.55])
"""Higher up, at both ends of x, the elbow would be nearly straight."""
MAX_LEAD_M = 0.030
"""The set point stays this close to the real hanger along each axis (12 N of spring): a blocked arm cannot wind up."""
FIT_TOLERANCE_M = 0.001
MAX_SIDE_M = 0.02
"""How far from y = 0 the hanger may start."""
POSITION_GAIN = 0.3
"""Share of a joint's error that position control takes back in one substep."""
_AXES = [0, 2]


class PandaHanger:
    """Holds the two corners in clips that are parts of the arm's last link; the anchors' error is zero."""

    spec: ClassVar[RobotSpec] = one_point("hanger", dx=0, dz=2)
    start_step_m: ClassVar[float] = 0.006

    def __init__(self, cloth: Cloth, corner_positions: FloatArray, *, control: Control = "impedance") -> None:
        """Put the arm, at rest, where its clips are at ``corner_positions`` (2, 3) m, row 0 at +y.

        The clips are HELD_STRETCH times the cloth's width apart, level and parallel to y; anything else is a SimError.
        ``control``: "impedance" (the thesis's arm: it yields to a push) or "position" (stiff joints).
        """
        if control not in get_args(Control):
            raise SimError(f"control is {control!r}; it must be one of {', '.join(get_args(Control))}")
        self._cloth = cloth
        self._client = cloth.world.client
        self._control = control
        self._clips = 0.5 * HELD_STRETCH * cloth.spec.width_m * np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
        centre = self._checked_centre(np.asarray(corner_positions, dtype=float))
        self._set_point = centre
        self._target = centre.copy()
        self._velocity = np.zeros(3)
        self._posture = inverse_kinematics(centre)
        self._posture_speed = np.zeros(JOINTS)
        self._torque = np.zeros(JOINTS)
        self._set_point_step = np.zeros(3)
        self._posture_step = np.zeros(JOINTS)
        """Of one substep."""
        self._resting = False
        self._guiding: HandGuiding | None = None
        self.arm = load_arm(self._client, float(self._clips[0, 1] - self._clips[1, 1]))
        for joint, angle in enumerate(self._posture):
            bullet.resetJointState(self.arm, joint, float(angle), 0.0, physicsClientId=self._client)
        self._impedance = CartesianImpedance(self._client, self.arm, cloth.world.substep_s)

    def _checked_centre(self, corners: FloatArray) -> FloatArray:
        centre = corners.mean(axis=0)
        if np.abs(corners - centre - self._clips).max() > FIT_TOLERANCE_M:
            wanted = np.round(self._clips, 4).tolist()
            raise SimError(
                f"corners {np.round(corners, 4).tolist()} do not fit the clips, which are at centre + {wanted}"
            )
        inside = (centre[_AXES] >= WORKSPACE_LOW_M - 1e-9) & (centre[_AXES] <= WORKSPACE_HIGH_M + 1e-9)
        if not inside.all() or abs(centre[1]) > MAX_SIDE_M:
            raise SimError(
                f"the hanger cannot start at {np.round(centre, 3).tolist()} m; x and z must be within "
                f"{WORKSPACE_LOW_M.tolist()} to {WORKSPACE_HIGH_M.tolist()}, y within {MAX_SIDE_M} of 0"
            )
        return centre

    def corner_positions(self) -> FloatArray:
        place, rotation = hanger_pose(self._client, self.arm)
        # The hand's y points to -y when it looks down.
        return place - self._clips @ rotation.T

    def position(self) -> FloatArray:
        return hanger_pose(self._client, self.arm)[0]

    def joint_angles(self) -> FloatArray:
        states = bullet.getJointStates(self.arm, range(JOINTS), physicsClientId=self._client)
        return np.array([state[0] for state in states])

    def set_point(self) -> FloatArray:
        """(3,) m, world: where the springs pull the corners' midpoint now."""
        return self._set_point.copy()

    def grip(self) -> None:
        # Both anchors sit on the last link; each keeps the offset at which its node is now.
        for node in self._cloth.spec.corners:
            self._cloth.anchor(node, self.arm, WRIST_LINK)

    def start_step(self, action: FloatArray, substeps: int) -> None:
        """``action`` (2,) m: dx, dz, added to the last set point; kept in the workspace and near the real hanger."""
        if self._resting:
            self._drive_joints(self._posture, np.zeros(JOINTS), np.zeros(JOINTS))
            self._resting = False
        self._end_guiding()
        step = np.asarray(action, dtype=float)
        if step.shape != (2,) or not np.isfinite(step).all():
            raise SimError(f"the action is {step.tolist()}; it must be two finite numbers: dx, dz in m")
        real = self.position()[_AXES]
        wanted = np.clip(self._set_point[_AXES] + step, real - MAX_LEAD_M, real + MAX_LEAD_M)
        self._target[_AXES] = np.clip(wanted, WORKSPACE_LOW_M, WORKSPACE_HIGH_M)
        self._lead(substeps)

    def _lead(self, substeps: int) -> None:
        """Set point and posture go evenly to the target in one step."""
        self._impedance.substep_s = self._cloth.world.substep_s
        duration = substeps * self._cloth.world.substep_s
        self._velocity = (self._target - self._set_point) / duration
        self._posture_speed = (inverse_kinematics(self._target) - self._posture) / duration
        self._set_point_step = self._velocity * self._cloth.world.substep_s
        self._posture_step = self._posture_speed * self._cloth.world.substep_s

    def start_guided_step(self, hand_m: FloatArray | None, substeps: int, load_n: float) -> None:
        """Begin one step of kinesthetic teaching: the arm yields in x and z to a hand at ``hand_m`` (3,) m, or to none.

        ``load_n``: weight of the cloth that hangs in the clips, which the arm carries besides its own.
        """
        if self._control != "impedance":
            raise SimError("position control does not yield; make the hanger with control='impedance'")
        place = self.position()
        if self._guiding is None:
            held_n = STIFFNESS_N_M * (self._set_point - place)
            self._guiding = HandGuiding(place, held_n, load_n, self._cloth.world.substep_s)
            self._impedance.yield_in_plane(True)
        if hand_m is not None:
            hand_m = np.array(hand_m, dtype=float)
            hand_m[_AXES] = np.clip(hand_m[_AXES], WORKSPACE_LOW_M, WORKSPACE_HIGH_M)
        self._guiding.substep_s = self._cloth.world.substep_s
        self._guiding.start_step(place, hand_m, substeps, load_n)
        # The springs are off along x and z: there the set point only has to lie where the arm's elbow belongs.
        self._target[_AXES] = np.clip(place[_AXES], WORKSPACE_LOW_M, WORKSPACE_HIGH_M)
        self._lead(substeps)

    def _end_guiding(self) -> None:
        """The springs take over what the arm carries now, so that nothing jumps."""
        if self._guiding is None:
            return
        place = self.position()
        self._set_point[_AXES] = (place + self._guiding.carried_n(place) / STIFFNESS_N_M)[_AXES]
        self._set_point[_AXES] = np.clip(self._set_point[_AXES], WORKSPACE_LOW_M, WORKSPACE_HIGH_M)
        self._guiding = None
        self._impedance.yield_in_plane(False)

    def hand_force_n(self) -> FloatArray:
        """(3,) N, world: mean force of the guiding hand on the hanger in the last step; zeros without."""
        return np.zeros(3) if self._guiding is None else self._guiding.hand_force_n()

    def before_substep(self) -> None:
        self._set_point += self._set_point_step
        self._posture += self._posture_step
        if self._guiding is not None:
            self._torque = self._guided_substep(self._guiding)
            return
        if self._control == "impedance":
            self._torque = self._impedance.apply(self._set_point, self._velocity, self._posture)
        else:
            # Straight lines in joint space: 20 mm of travel bend by less than 0.1 mm.
            self._drive_joints(self._posture, self._posture_speed, TORQUE_LIMIT_N_M)

    def _guided_substep(self, guiding: HandGuiding) -> FloatArray:
        place = self.position()
        force = guiding.hand_push_n(place)
        bullet.applyExternalForce(
            self.arm, WRIST_LINK, force.tolist(), place.tolist(), bullet.WORLD_FRAME, physicsClientId=self._client
        )
        inside = place.copy()
        inside[_AXES] = np.clip(place[_AXES], WORKSPACE_LOW_M, WORKSPACE_HIGH_M)
        carried = guiding.carried_n(place) + WALL_STIFFNESS_N_M * (inside - place)
        # Damped against rest, not against the set point, which only follows.
        return self._impedance.apply(self._set_point, np.zeros(3), self._posture, carried)

    def _drive_joints(self, angles: FloatArray, speeds: FloatArray, torque_limits: FloatArray) -> None:
        """Motors on all joints (7,): rad, rad/s, N m."""
        bullet.setJointMotorControlArray(
            self.arm,
            range(JOINTS),
            bullet.POSITION_CONTROL,
            targetPositions=angles.tolist(),
            targetVelocities=speeds.tolist(),
            forces=torque_limits.tolist(),
            positionGains=[POSITION_GAIN] * JOINTS,
            velocityGains=[1.0] * JOINTS,
            physicsClientId=self._client,
        )

    def rest(self) -> None:
        # Torques last for one substep, motors until they are told otherwise.
        self._drive_joints(self.joint_angles(), np.zeros(JOINTS), TORQUE_LIMIT_N_M)
        self._resting = True

    def spring_force_n(self) -> FloatArray:
        """(3,) N, world: pull of the springs on the hanger; with the arm at rest the opposite of its load."""
        if self._control != "impedance":
            raise SimError("position control has no springs; make the hanger with control='impedance'")
        return STIFFNESS_N_M * (self._set_point - self.position())

    def joint_torques(self) -> FloatArray:
        """(7,) N m that the joints were driven with in the last substep."""
        if self._control == "impedance":
            return self._torque.copy()
        states = bullet.getJointStates(self.arm, range(JOINTS), physicsClientId=self._client)
        return np.array([state[3] for state in states])
