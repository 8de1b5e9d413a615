"""The Panda arm with a two-clip hanger in its hand as a robot description (URDF)."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.sim.errors import SimError
from layflat.sim.robots.panda import CLIP_DROP_M, FLANGE_M, GRIP_DEPTH_M, HAND_YAW_RAD, JOINTS

BAR_MASS_KG = 0.12
CLIP_MASS_KG = 0.03
BAR_THICKNESS_M = 0.008
CLIP_SIZE_M = (0.006, 0.012, CLIP_DROP_M)
FINGER_HEIGHT_M = 0.0584
ARM_RGBA = "0.90 0.90 0.90 1"
HANGER_RGBA = "0.25 0.25 0.25 1"

_MESHES = Path(str(files("pybullet_data"))) / "franka_panda" / "meshes" / "collision"
"""Data files alone, which need no engine."""
_SOURCE = _MESHES.parent.parent / "panda.urdf"


@dataclass(frozen=True, kw_only=True)
class _Part:
    """A box-shaped piece of the wrist, in the hand's frame (z to the fingers, y along the bar)."""

    mass_kg: float
    centre_m: tuple[float, float, float]
    """Centre of mass of the piece."""
    size_m: tuple[float, float, float]

    def inertia(self, about: FloatArray) -> FloatArray:
        """Return the diagonal, (3,) kg m^2, about axes through ``about``; products vanish by the wrist's symmetry."""
        away = np.array(self.centre_m) - about
        return box_inertia(self.mass_kg, self.size_m) + self.mass_kg * (away @ away - away**2)


def arm_urdf(clip_distance_m: float) -> bytes:
    """Make the robot description from pybullet_data's Panda, with three changes.

    Everything behind the last joint is one link: each fixed link costs time in every substep, and Bullet's own merging
    misplaces the centre of mass. No collision shapes: the clips would push the cloth that they hold. Inertias of uniform
    boxes around each mesh: the file has 0.1 kg m^2 for every link, a fingertip as much as the shoulder.
    """
    if not 0.05 <= clip_distance_m <= 0.8:
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
    """Return a pose given in the hand's frame as an origin on the last link."""
    c, s = math.cos(HAND_YAW_RAD), math.sin(HAND_YAW_RAD)
    x, y, z = xyz
    place = (c * x - s * y, s * x + c * y, z + FLANGE_M)
    return ET.Element("origin", xyz=" ".join(f"{v:.9f}" for v in place), rpy=f"0 0 {HAND_YAW_RAD + turn:.12f}")


def _add_mesh(link: ET.Element, mesh: Path, origin: ET.Element | None = None) -> None:
    # Collision meshes as visuals: the fine ones would add 20 ms to every camera image.
    _add_visual(link, origin, ET.Element("mesh", filename=str(mesh)), "arm", ARM_RGBA)


def _add_box(link: ET.Element, size: tuple[float, ...], centre: tuple[float, ...]) -> None:
    box = ET.Element("box", size=" ".join(f"{s:.9f}" for s in size))
    _add_visual(link, _hand_origin(centre), box, "hanger", HANGER_RGBA)


def _add_visual(link: ET.Element, origin: ET.Element | None, shape: ET.Element, material: str, rgba: str) -> None:
    visual = ET.SubElement(link, "visual")
    if origin is not None:
        visual.append(origin)
    ET.SubElement(visual, "geometry").append(shape)
    ET.SubElement(ET.SubElement(visual, "material", name=material), "color", rgba=rgba)


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
