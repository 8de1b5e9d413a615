"""The Panda arm with a two-clip hanger in its hand as a robot description (URDF)."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.sim.errors import SimError
from layflat.sim.physics.base import Vector
from layflat.sim.robots.panda import CLIP_DROP_M, FLANGE_M, GRIP_DEPTH_M, HAND_YAW_RAD, JOINTS

BAR_MASS_KG = 0.12
CLIP_MASS_KG = 0.03
BAR_THICKNESS_M = 0.008
CLIP_SIZE_M = (0.006, 0.012, CLIP_DROP_M)
FINGER_HEIGHT_M = 0.0584

_MESHES = Path(str(files("pybullet_data"))) / "franka_panda" / "meshes" / "collision"
"""Data files alone, which need no engine."""
_SOURCE = _MESHES.parent.parent / "panda.urdf"


@lru_cache(maxsize=8)
def arm_urdf(clip_distance_m: float) -> bytes:
    """Make the robot description from pybullet_data's Panda, with three changes.

    Everything behind the last joint is one link: each fixed link costs time in every substep, and Bullet's own merging
    misplaces the centre of mass. No collision shapes: the clips would push the cloth that they hold. Inertias are those
    of boxes around each mesh: the file has 0.1 kg m^2 for every link, a fingertip as much as the shoulder. A distance
    of 0 makes a gripper that holds a single clip.
    """
    if clip_distance_m and not 0.05 <= clip_distance_m <= 0.8:
        raise SimError(f"the clips are {clip_distance_m} m apart; a hanger of 0.05 to 0.8 m can be made")
    robot = ET.parse(_SOURCE).getroot()
    arm = {f"panda_link{i}" for i in range(JOINTS + 1)}
    masses = {
        link.get("name"): float(_find(link, "inertial/mass").get("value", "nan")) for link in robot.findall("link")
    }
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
    """Return the inertia of a uniform box about its centre, (3,) kg m^2."""
    squares = np.array(size_m) ** 2
    return mass_kg / 12 * (squares.sum() - squares)


def _add_wrist(link: ET.Element, clip_distance_m: float, masses_kg: tuple[float, float, float]) -> None:
    """Put hand, closed fingers, bar and clips on the last link; masses of the link, the hand and one finger."""
    flange_kg, hand_kg, finger_kg = masses_kg
    bar_size = (BAR_THICKNESS_M, clip_distance_m + CLIP_SIZE_M[1], BAR_THICKNESS_M)
    hand, finger = _MESHES / "hand.obj", _MESHES / "finger.obj"
    # Mass, centre of mass and size of each box in the hand's frame (z to the fingers, y along the bar); the centres of
    # the first two are those of the original description.
    parts: list[tuple[float, Vector, Vector]] = [
        (flange_kg, (0, 0, 0.08 - FLANGE_M), _extent(_MESHES / "link7.obj")),
        (hand_kg, (0, 0, 0.04), _extent(hand)),
        (BAR_MASS_KG, (0, 0, GRIP_DEPTH_M), bar_size),
    ]
    _add_mesh(link, hand, _hand_origin())
    _add_box(link, bar_size, (0, 0, GRIP_DEPTH_M))
    for side in (1, -1):
        # With one clip both halves are the same: its weight is that of two.
        clip = (0, clip_distance_m / 2 * side, GRIP_DEPTH_M + CLIP_DROP_M / 2)
        parts.append((finger_kg, (0, 0.01 * side, FINGER_HEIGHT_M + 0.02), _extent(finger)))
        parts.append((CLIP_MASS_KG, clip, CLIP_SIZE_M))
        _add_mesh(link, finger, _hand_origin((0, 0, FINGER_HEIGHT_M), turn=0 if side > 0 else math.pi))
        _add_box(link, CLIP_SIZE_M, clip)
    mass = sum(kg for kg, _, _ in parts)
    centre_of_mass = sum((kg * np.array(centre) for kg, centre, _ in parts), np.zeros(3)) / mass
    inertia = np.zeros(3)
    for kg, centre, size in parts:  # products vanish by the wrist's symmetry
        away = np.array(centre) - centre_of_mass
        inertia = inertia + (box_inertia(kg, size) + kg * (away @ away - away**2))
    inertial = _find(link, "inertial")
    inertial.remove(_find(inertial, "origin"))
    inertial.insert(0, ET.fromstring(_hand_origin(tuple(centre_of_mass))))
    _find(inertial, "mass").set("value", repr(float(mass)))
    _set_inertia(link, inertia)


def _hand_origin(xyz: tuple[float, ...] = (0.0, 0.0, 0.0), turn: float = 0.0) -> str:
    """Return a pose given in the hand's frame as an origin on the last link."""
    c, s = math.cos(HAND_YAW_RAD), math.sin(HAND_YAW_RAD)
    x, y, z = xyz
    return (
        f'<origin xyz="{_numbers((c * x - s * y, s * x + c * y, z + FLANGE_M))}" rpy="0 0 {HAND_YAW_RAD + turn:.12f}"/>'
    )


def _numbers(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:.9f}" for value in values)


def _add_mesh(link: ET.Element, mesh: Path, origin: str = "") -> None:
    # Collision meshes as visuals: the fine ones would add 20 ms to every camera image.
    _add_visual(link, origin, f"<mesh filename={quoteattr(str(mesh))}/>")


def _add_box(link: ET.Element, size: Vector, centre: Vector) -> None:
    _add_visual(link, _hand_origin(centre), f'<box size="{_numbers(size)}"/>')


def _add_visual(link: ET.Element, origin: str, shape: str) -> None:
    link.append(ET.fromstring(f"<visual>{origin}<geometry>{shape}</geometry></visual>"))


def _find(element: ET.Element, path: str) -> ET.Element:
    found = element.find(path)
    if found is None:
        raise SimError(f"{_SOURCE}: {element.tag} {element.get('name', '')} has no {path}; pybullet_data has changed")
    return found


def _set_inertia(link: ET.Element, diagonal: FloatArray) -> None:
    inertia = _find(link, "inertial/inertia")
    for name, value in zip(("ixx", "iyy", "izz"), diagonal, strict=True):
        inertia.set(name, repr(float(value)))


def _extent(mesh: Path) -> tuple[float, float, float]:
    """Return the size of the box around an OBJ file's vertices, m."""
    lines = (line.split() for line in mesh.read_text().splitlines() if line.startswith("v "))
    vertices = np.array([[float(v) for v in line[1:4]] for line in lines])
    x, y, z = np.ptp(vertices, axis=0)
    return float(x), float(y), float(z)
