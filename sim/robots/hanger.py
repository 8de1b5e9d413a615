"""PandaHanger: a Panda arm with a two-clip hanger that carries the corners in x and z (chapters 3-3-1 and 4-3)."""

from __future__ import annotations

from functools import lru_cache
from typing import ClassVar, get_args

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.cloth_frame import NOMINAL_M
from layflat.data.robot import RobotSpec, one_point
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.errors import SimError
from layflat.sim.physics.base import Arm, Cloth, Vector, World
from layflat.sim.robots.arm_shape import ArmShape, ArmSolid, shape_from_urdf
from layflat.sim.robots.base import STIFFNESS_N_M, Control, Robot
from layflat.sim.robots.hand_guiding import WALL_STIFFNESS_N_M, HandGuiding
from layflat.sim.robots.impedance import CartesianImpedance
from layflat.sim.robots.panda import BASE_POSITION_M, JOINTS, TOOL_M, TORQUE_LIMIT_N_M, inverse_kinematics
from layflat.sim.robots.panda_description import arm_urdf

MAX_SIDE_M = 0.02
"""Distance from y = 0 at which the hanger may start."""
MAX_LEAD_M = 0.030
"""The set point stays this close to the real hanger along each axis (12 N of spring): a blocked arm cannot wind up."""
FIT_TOLERANCE_M = 0.001
BASE_CLEARANCE_M = 0.12
"""Least distance along y between the arm's axis and the hanger's end."""
_AXES = [0, 2]


class PandaHanger(Robot):
    """Holds the two corners in clips that are parts of the arm's last link; the anchors' error is zero."""

    spec: ClassVar[RobotSpec] = one_point("hanger", dx=0, dz=2)
    start_step_m: ClassVar[float] = 0.006
    workspace_low_m = (-0.10, -MAX_SIDE_M, 0.004)
    """Bounds of the corners' set point; z is the height at which cloth rests."""
    workspace_high_m = (0.60, MAX_SIDE_M, 0.55)
    """Higher up, at both ends of x, the elbow would be nearly straight."""

    def __init__(
        self,
        cloth: Cloth,
        corner_positions: FloatArray,
        *,
        control: Control = "impedance",
        stiffness_n_m: float = STIFFNESS_N_M,
    ) -> None:
        """Put the arm, at rest, where its clips are at ``corner_positions`` (2, 3) m, row 0 at +y.

        The clips are the cloth's ``held_width_m`` apart, level and parallel to y; anything else is a SimError.
        ``control``: "impedance" (the thesis's arm: it yields to a push) or "position" (stiff joints).
        """
        if control not in get_args(Control):
            raise SimError(f"control is {control!r}; it must be one of {', '.join(get_args(Control))}")
        self._cloth = cloth
        self._world = cloth.world
        self._control, self._stiffness_n_m = control, stiffness_n_m
        self._low, self._high = (bound[_AXES] for bound in self.workspace(cloth.spec))
        self._base_m = base_position_m(cloth.spec)
        self._clips = 0.5 * cloth.spec.held_width_m * np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
        centre = self._checked_centre(np.asarray(corner_positions, dtype=float))
        self.set_point = centre
        """Where the springs pull the corners' midpoint now, (3,) m, world."""
        self._target = centre.copy()
        self._velocity = np.zeros(3)
        self._posture = inverse_kinematics(centre, self._base_m)
        self._posture_speed = np.zeros(JOINTS)
        self._set_point_step = np.zeros(3)
        """Change of the set point in one substep."""
        self._posture_step = np.zeros(JOINTS)
        self._holding = False
        self._guiding: HandGuiding | None = None
        self.arm = self.add_arm(self._world, cloth.spec)
        self.arm.reset_joints(self._posture)
        self._impedance = CartesianImpedance(self.arm, self._world.substep_s, stiffness_n_m)

    @classmethod
    def add_arm(cls, world: World, cloth: ClothSpec) -> Arm:
        arm = world.add_arm(arm_urdf(cloth.held_width_m), base_position_m(cloth), joints=JOINTS, tool_m=TOOL_M)
        world.solids.append(ArmSolid(cls.arm_shape(cloth), arm))
        return arm

    @classmethod
    def joint_angles_at(cls, position: FloatArray, cloth: ClothSpec) -> FloatArray:
        return inverse_kinematics(position, base_position_m(cloth))

    @classmethod
    def arm_shape(cls, cloth: ClothSpec) -> ArmShape:
        return _arm_shape(cloth.held_width_m, base_position_m(cloth))

    def _checked_centre(self, corners: FloatArray) -> FloatArray:
        centre = corners.mean(axis=0)
        if np.abs(corners - centre - self._clips).max() > FIT_TOLERANCE_M:
            wanted = np.round(self._clips, 4).tolist()
            raise SimError(
                f"corners {np.round(corners, 4).tolist()} do not fit the clips, which are at centre + {wanted}"
            )
        inside = (centre[_AXES] >= self._low - 1e-9) & (centre[_AXES] <= self._high + 1e-9)
        if not inside.all() or abs(centre[1]) > MAX_SIDE_M:
            raise SimError(
                f"the hanger cannot start at {np.round(centre, 3).tolist()} m; x and z must be within "
                f"{self._low.tolist()} to {self._high.tolist()}, y within {MAX_SIDE_M} of 0"
            )
        return centre

    def corner_positions(self) -> FloatArray:
        place, rotation = self.arm.tool_pose()
        # The hand's y points to -y when it looks down.
        return place - self._clips @ rotation.T

    def position(self) -> FloatArray:
        return self.arm.tool_pose()[0]

    def joint_angles(self) -> FloatArray:
        return np.array(self.arm.joint_states()[0])

    def grasp(self) -> None:
        self.arm.grasp(self._cloth, self._cloth.spec.corners)

    def start_step(self, action: FloatArray, substeps: int) -> None:
        """Add ``action`` (2,) m, dx and dz, to the set point, kept in the workspace and near the real hanger."""
        if self._holding:
            self.arm.drive_joints(self._posture, np.zeros(JOINTS), np.zeros(JOINTS))
            self._holding = False
        self._end_guiding()
        step = np.asarray(action, dtype=float)
        if step.shape != (2,) or not np.isfinite(step).all():
            raise SimError(f"the action is {step.tolist()}; it must be two finite numbers: dx, dz in m")
        real = self.position()[_AXES]
        wanted = np.clip(self.set_point[_AXES] + step, real - MAX_LEAD_M, real + MAX_LEAD_M)
        self._target[_AXES] = np.clip(wanted, self._low, self._high)
        self._lead(substeps)

    def _lead(self, substeps: int) -> None:
        """Move set point and posture evenly to the target in one step."""
        substep_s = self._world.substep_s
        self._impedance.substep_s = substep_s
        duration = substeps * substep_s
        try:
            posture = inverse_kinematics(self._target, self._base_m)
        except SimError:  # The workspace's upper corner behind a cloth longer than 0.5 m.
            self._target, posture = self.set_point.copy(), self._posture
        self._velocity = (self._target - self.set_point) / duration
        self._posture_speed = (posture - self._posture) / duration
        self._set_point_step = self._velocity * substep_s
        self._posture_step = self._posture_speed * substep_s

    def start_guided_step(self, hand_m: FloatArray | None, substeps: int, load_n: float) -> None:
        """Yield along x and z to a hand at ``hand_m`` (3,) m; the arm carries its own weight and ``load_n``."""
        if self._control != "impedance":
            raise SimError("position control does not yield; make the hanger with control='impedance'")
        place = self.position()
        if self._guiding is None:
            held_n = self._stiffness_n_m * (self.set_point - place)
            self._guiding = HandGuiding(place, held_n, load_n, self._world.substep_s)
            self._impedance.yield_in_plane(True)
        if hand_m is not None:
            hand_m = np.array(hand_m, dtype=float)
            hand_m[_AXES] = np.clip(hand_m[_AXES], self._low, self._high)
        self._guiding.substep_s = self._world.substep_s
        self._guiding.start_step(place, hand_m, substeps, load_n)
        # The springs are off along x and z: there the set point only has to lie where the arm's elbow belongs.
        self._target[_AXES] = np.clip(place[_AXES], self._low, self._high)
        self._lead(substeps)

    def _end_guiding(self) -> None:
        """Let the springs take over what the arm carries now, so that nothing jumps."""
        if self._guiding is None:
            return
        place = self.position()
        self.set_point[_AXES] = (place + self._guiding.carried_n(place) / self._stiffness_n_m)[_AXES]
        self.set_point[_AXES] = np.clip(self.set_point[_AXES], self._low, self._high)
        self._guiding = None
        self._impedance.yield_in_plane(False)

    def before_substep(self) -> None:
        self.set_point += self._set_point_step
        self._posture += self._posture_step
        if self._guiding is not None:
            self._guided_substep(self._guiding)
        elif self._control == "impedance":
            self._impedance.apply(self.set_point, self._velocity, self._posture)
        else:
            # Straight lines in joint space: 20 mm of travel bend by less than 0.1 mm.
            self.arm.drive_joints(self._posture, self._posture_speed, TORQUE_LIMIT_N_M)

    def _guided_substep(self, guiding: HandGuiding) -> None:
        place = self.position()
        force = guiding.hand_push_n(place)
        self.arm.push_tool(force, place)
        inside = place.copy()
        inside[_AXES] = np.clip(place[_AXES], self._low, self._high)
        carried = guiding.carried_n(place) + WALL_STIFFNESS_N_M * (inside - place)
        # Damped against rest, not against the set point, which only follows.
        self._impedance.apply(self.set_point, np.zeros(3), self._posture, carried)

    def hold(self) -> None:
        # Torques last for one substep, motors until further notice.
        self.arm.drive_joints(self.joint_angles(), np.zeros(JOINTS), TORQUE_LIMIT_N_M)
        self._holding = True


def base_position_m(cloth: ClothSpec) -> Vector:
    """Return where the arm stands: on a block for a cloth longer than the towel, further aside for a wide one."""
    x, y, z = BASE_POSITION_M
    return x, max(y, cloth.held_width_m / 2 + BASE_CLEARANCE_M), z + max(0.0, cloth.length_m - NOMINAL_M)


@lru_cache(maxsize=8)
def _arm_shape(held_width_m: float, base_m: Vector) -> ArmShape:
    return shape_from_urdf(arm_urdf(held_width_m), base_m, JOINTS)
