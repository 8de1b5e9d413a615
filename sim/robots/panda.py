"""The Panda arm with a two-clip hanger in its hand: robot description and inverse kinematics, hand straight down.

The arm stands beside the cloth, not behind it: with the hand straight down a Panda covers radii of 0.30 to 0.80 m near
the table, which is less than the 0.7 m that the hanger travels along x. From the side that travel is an arc of radii
0.40 to 0.53 m, and a camera on the other side of the table looks under the forearm.
"""

from __future__ import annotations

import math
import os
import tempfile
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pybullet as bullet
import pybullet_data

from layflat.data.arrays import FloatArray
from layflat.sim.errors import SimError

JOINTS = 7
TORQUE_LIMIT_N_M = np.array([87.0] * 4 + [12.0] * 3)
JOINT_LOW_RAD = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973])
JOINT_HIGH_RAD = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])
"""The maker's limits (soft limits of the robot description); Bullet itself stops at wider ones."""

BASE_POSITION_M = (0.25, 0.40, 0.0)
"""Beside the table's middle, facing +x; the hanger works to its right."""

# Distances between joint axes, m.
SHOULDER_HEIGHT_M = 0.333
UPPER_ARM_M = 0.316
ELBOW_OFFSET_M = 0.0825
FOREARM_M = 0.384
WRIST_OFFSET_M = 0.088
FLANGE_M = 0.107
HAND_YAW_RAD = -math.pi / 4
"""Of the hand on the last link, about its axis."""

GRIP_DEPTH_M = 0.105
"""From the flange to where the closed fingers hold the hanger's bar."""
CLIP_DROP_M = 0.070
"""From the bar down to the corners in the clips: fingers and bar stay above the table when the corners lie on it."""
TOOL_M = FLANGE_M + GRIP_DEPTH_M + CLIP_DROP_M
BAR_MASS_KG = 0.12
CLIP_MASS_KG = 0.03
BAR_THICKNESS_M = 0.008
CLIP_SIZE_M = (0.006, 0.012, CLIP_DROP_M)
FINGER_HEIGHT_M = 0.0584
ARM_RGBA = "0.90 0.90 0.90 1"
HANGER_RGBA = "0.25 0.25 0.25 1"

WRIST_LINK = JOINTS - 1
"""The last link; hand, fingers, bar and clips are part of it."""
_MESHES = Path(pybullet_data.getDataPath()) / "franka_panda" / "meshes" / "collision"
_SOURCE = _MESHES.parent.parent / "panda.urdf"


@dataclass(frozen=True, kw_only=True)
class _Part:
    """A box-shaped piece of the wrist, in the hand's frame (z to the fingers, y along the bar)."""

    mass_kg: float
    centre_m: tuple[float, float, float]
    """Centre of mass."""
    size_m: tuple[float, float, float]

    def inertia(self, about: FloatArray) -> FloatArray:
        """(3,) kg m^2, diagonal about axes through ``about``; products vanish by the wrist's symmetry."""
        away = np.array(self.centre_m) - about
        return box_inertia(self.mass_kg, self.size_m) + self.mass_kg * (away @ away - away**2)


def load_arm(client: int, clip_distance_m: float) -> int:
    """Load the arm at its base, without collisions and without motors; returns the body."""
    handle, path = tempfile.mkstemp(suffix=".urdf")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(arm_urdf(clip_distance_m))
        arm = bullet.loadURDF(
            path, BASE_POSITION_M, useFixedBase=True, flags=bullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client
        )
    finally:
        os.unlink(path)
    joints = list(range(JOINTS))
    for link in range(-1, JOINTS):
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
        arm, joints, bullet.VELOCITY_CONTROL, forces=[0.0] * JOINTS, physicsClientId=client
    )
    return int(arm)


def arm_urdf(clip_distance_m: float) -> bytes:
    """Robot description made from pybullet_data's Panda.

    Three changes. Everything behind the last joint is one link, since each fixed link costs time in every substep
    (Bullet's own merging of fixed links misplaces the centre of mass). No collision shapes: the clips would push the
    very cloth that they hold, and clip and cloth touch nothing else. Inertias of uniform boxes around each
    mesh: the file has 0.1 kg m^2 for every link, a fingertip as much as the shoulder.
    """
    if not 0.05 <= clip_distance_m <= 0.8:
        raise SimError(f"the clips are {clip_distance_m} m apart; a hanger of 0.05 to 0.8 m can be made")
    robot = ET.parse(_SOURCE).getroot()
    arm = {f"panda_link{i}" for i in range(JOINTS + 1)}
    masses = {link.get("name"): _mass(link) for link in robot.findall("link")}
    for joint in robot.findall("joint"):
        if _find(joint, "child").get("link") not in arm:
            robot.remove(joint)
    for link in robot.findall("link"):
        name = link.get("name", "")
        if name not in arm:
            robot.remove(link)
            continue
        mesh = _MESHES / f"{name.removeprefix('panda_')}.obj"
        for unwanted in link.findall("visual") + link.findall("collision"):
            link.remove(unwanted)
        _add_mesh(link, mesh)
        _set_inertia(link, box_inertia(masses[name], _extent(mesh)))
        if name == f"panda_link{JOINTS}":
            _add_wrist(link, clip_distance_m, (masses[name], masses["panda_hand"], masses["panda_leftfinger"]))
    return ET.tostring(robot)


def box_inertia(mass_kg: float, size_m: tuple[float, float, float]) -> FloatArray:
    """(3,) kg m^2 of a uniform box about its centre."""
    squares = np.array(size_m) ** 2
    return mass_kg / 12 * (squares.sum() - squares)


def inverse_kinematics(centre: FloatArray) -> FloatArray:
    """(7,) rad: hand straight down, bar along y, corners' midpoint at ``centre`` (3,) m world; exact, elbow up.

    Joints 3 and 5 stay at zero, so that shoulder, elbow and wrist lie in one vertical plane and the law of cosines
    gives the elbow. Limits are not checked, reach is: SimError.
    """
    x, y = centre[0] - BASE_POSITION_M[0], centre[1] - BASE_POSITION_M[1]
    out = math.hypot(x, y) - WRIST_OFFSET_M
    up = centre[2] + TOOL_M - BASE_POSITION_M[2] - SHOULDER_HEIGHT_M
    upper, fore = math.hypot(UPPER_ARM_M, ELBOW_OFFSET_M), math.hypot(FOREARM_M, ELBOW_OFFSET_M)
    reach = math.hypot(out, up)
    if not abs(upper - fore) < reach < upper + fore:
        raise SimError(f"the arm cannot reach {np.round(centre, 3).tolist()} m with its hand straight down")
    # Tilts from the vertical, in the arm's plane.
    lead = math.acos((upper**2 + reach**2 - fore**2) / (2 * upper * reach))
    upper_tilt = math.atan2(out, up) - lead
    elbow_out, elbow_up = upper * math.sin(upper_tilt), upper * math.cos(upper_tilt)
    fore_tilt = math.atan2(out - elbow_out, up - elbow_up) + math.atan2(ELBOW_OFFSET_M, FOREARM_M)
    joint1 = math.atan2(y, x)
    joint2 = upper_tilt - math.atan2(ELBOW_OFFSET_M, UPPER_ARM_M)
    return np.array([joint1, joint2, 0.0, joint2 - fore_tilt, 0.0, fore_tilt, joint1 - HAND_YAW_RAD])


def _add_wrist(link: ET.Element, clip_distance_m: float, masses_kg: tuple[float, float, float]) -> None:
    """Put hand, closed fingers, bar and clips on the last link; masses of the link, the hand and one finger."""
    flange_kg, hand_kg, finger_kg = masses_kg
    bar_size = (BAR_THICKNESS_M, clip_distance_m + CLIP_SIZE_M[1], BAR_THICKNESS_M)
    clip_z = GRIP_DEPTH_M + CLIP_DROP_M / 2
    hand, finger = _MESHES / "hand.obj", _MESHES / "finger.obj"
    parts = [
        # Centres of mass of the first three as in the original description.
        _Part(mass_kg=flange_kg, centre_m=(0, 0, 0.08 - FLANGE_M), size_m=_extent(_MESHES / "link7.obj")),
        _Part(mass_kg=hand_kg, centre_m=(0, 0, 0.04), size_m=_extent(hand)),
        _Part(mass_kg=BAR_MASS_KG, centre_m=(0, 0, GRIP_DEPTH_M), size_m=bar_size),
    ]
    _add_mesh(link, hand, _hand_origin())
    _add_box(link, bar_size, (0, 0, GRIP_DEPTH_M))
    for side in (1, -1):
        centre = (0, 0.01 * side, FINGER_HEIGHT_M + 0.02)
        parts.append(_Part(mass_kg=finger_kg, centre_m=centre, size_m=_extent(finger)))
        clip = (0, clip_distance_m / 2 * side, clip_z)
        parts.append(_Part(mass_kg=CLIP_MASS_KG, centre_m=clip, size_m=CLIP_SIZE_M))
        _add_mesh(link, finger, _hand_origin((0, 0, FINGER_HEIGHT_M), turn=0 if side > 0 else math.pi))
        _add_box(link, CLIP_SIZE_M, clip)
    mass = sum(part.mass_kg for part in parts)
    centre_of_mass = sum((part.mass_kg * np.array(part.centre_m) for part in parts), np.zeros(3)) / mass
    inertial = _find(link, "inertial")
    inertial.remove(_find(inertial, "origin"))
    inertial.insert(0, _hand_origin(tuple(centre_of_mass)))
    _find(inertial, "mass").set("value", repr(float(mass)))
    _set_inertia(link, sum((part.inertia(centre_of_mass) for part in parts), np.zeros(3)))


def _hand_origin(xyz: tuple[float, ...] = (0.0, 0.0, 0.0), turn: float = 0.0) -> ET.Element:
    """A pose given in the hand's frame, as an origin on the last link."""
    c, s = math.cos(HAND_YAW_RAD), math.sin(HAND_YAW_RAD)
    x, y, z = xyz
    place = (c * x - s * y, s * x + c * y, z + FLANGE_M)
    return ET.Element("origin", xyz=" ".join(f"{v:.9f}" for v in place), rpy=f"0 0 {HAND_YAW_RAD + turn:.12f}")


def _add_mesh(link: ET.Element, mesh: Path, origin: ET.Element | None = None) -> None:
    # Collision meshes as visuals: the fine ones would add 20 ms to every camera image.
    geometry = _add_visual(link, origin, "arm", ARM_RGBA)
    ET.SubElement(geometry, "mesh", filename=str(mesh))


def _add_box(link: ET.Element, size: tuple[float, ...], centre: tuple[float, ...]) -> None:
    geometry = _add_visual(link, _hand_origin(centre), "hanger", HANGER_RGBA)
    ET.SubElement(geometry, "box", size=" ".join(f"{s:.9f}" for s in size))


def _add_visual(link: ET.Element, origin: ET.Element | None, material: str, rgba: str) -> ET.Element:
    visual = ET.SubElement(link, "visual")
    if origin is not None:
        visual.append(origin)
    geometry = ET.SubElement(visual, "geometry")
    ET.SubElement(ET.SubElement(visual, "material", name=material), "color", rgba=rgba)
    return geometry


def _find(element: ET.Element, path: str) -> ET.Element:
    found = element.find(path)
    if found is None:
        raise SimError(f"{_SOURCE}: {element.tag} {element.get('name', '')} has no {path}; pybullet_data has changed")
    return found


def _mass(link: ET.Element) -> float:
    return float(_find(link, "inertial/mass").get("value", "nan"))


def _set_inertia(link: ET.Element, diagonal: FloatArray) -> None:
    inertia = _find(link, "inertial/inertia")
    for name, value in zip(("ixx", "iyy", "izz"), diagonal, strict=True):
        inertia.set(name, repr(float(value)))


def _extent(mesh: Path) -> tuple[float, float, float]:
    """Size of the box around an OBJ file's vertices, m."""
    lines = (line.split() for line in mesh.read_text().splitlines() if line.startswith("v "))
    vertices = np.array([[float(v) for v in line[1:4]] for line in lines])
    x, y, z = np.ptp(vertices, axis=0)
    return float(x), float(y), float(z)
