"""The world as MuJoCo's XML: table, arm, cloth, and what holds its nodes."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.errors import SimError
from layflat.sim.physics.base import Vector
from layflat.sim.physics.mujoco.material import young_and_thickness

CLOTH = "cloth"
CONTACT = 'solref="0.01 1" solimp="0.9 0.95 0.001" condim="3"'
HOLD = 'solref="0.005 1" solimp="0.99 0.999 0.001"'
DAMPING_S = 0.005
_OPTIONS = 'solver="CG" iterations="100" tolerance="1e-6" cone="elliptic" jacobian="sparse" integrator="discrete"'


def world_text(
    *, parts: Iterable[str], table_friction: float, points: Iterable[int], held: Iterable[tuple[str, int]]
) -> str:
    """Return the model of a world.

    ``parts``: texts of cloth and arm. ``points``: keys of the kinematic points. ``held``: names of bodies, each with
    the node that it holds.
    """
    bodies = "".join(f'<body name="point{key}" mocap="true"/>' for key in points)
    joins = "".join(f'<connect body1="{body}" body2="{CLOTH}_{node}" anchor="0 0 0" {HOLD}/>' for body, node in held)
    return (
        f'<mujoco><option {_OPTIONS}><flag autoreset="disable"/></option><compiler angle="radian"/>'
        f"<worldbody>{_table(table_friction)}{bodies}{''.join(parts)}</worldbody>"
        f"<equality>{joins}</equality></mujoco>"
    )


def _table(friction: float) -> str:
    # An infinite plane has one contact a node, a box three a triangle, at twice the cost. By its priority the pair has
    # this friction, not the greater one.
    return f'<geom type="plane" size="1 1 1" friction="{friction} 0 0" priority="1" {CONTACT}/>'


def cloth_text(spec: ClothSpec, nodes: FloatArray) -> str:
    """Return a cloth with its nodes at rest, (N, 3) m."""
    young, thickness = young_and_thickness(spec)
    return (
        f'<flexcomp name="{CLOTH}" type="direct" dim="2" mass="{spec.mass_kg}" radius="{spec.margin_m}"'
        f' point="{_numbers(nodes.ravel())}" element="{" ".join(map(str, spec.triangles().ravel()))}">'
        f'<contact selfcollide="auto" friction="{spec.friction} 0 0" {CONTACT}/>'
        f'<elasticity young="{young!r}" poisson="0" thickness="{thickness!r}" damping="{DAMPING_S}"'
        ' elastic2d="both"/></flexcomp>'
    )


def arm_text(urdf: bytes, base_position_m: Vector, joints: int) -> str:
    """Return an arm of a robot description, a chain of revolute joints about z without shapes, as nested bodies."""
    robot = ET.fromstring(urdf)
    links = {str(link.get("name")): link for link in robot.findall("link")}
    by_child = {str(_find(joint, "child").get("link")): joint for joint in robot.findall("joint")}
    text = ""
    for k in range(joints, 0, -1):
        name = f"panda_link{k}"
        joint = by_child[name]
        if (axis := joint.find("axis")) is not None and axis.get("xyz", "").split() != ["0", "0", "1"]:
            raise SimError(f"joint {joint.get('name')} of the arm does not turn about its z")
        body = "tool" if k == joints else f"arm{k}"
        text = (
            f'<body name="{body}" {_pose(_find(joint, "origin"))}>{_inertial(links[name])}'
            f'<joint name="arm{k}" axis="0 0 1"/>{text}</body>'
        )
    return f'<body name="arm0" pos="{_numbers(base_position_m)}">{text}</body>'


def _inertial(link: ET.Element) -> str:
    inertia = _find(link, "inertial/inertia")
    values = _numbers([float(inertia.get(name, "0")) for name in ("ixx", "iyy", "izz")])
    mass = _find(link, "inertial/mass").get("value")
    return f'<inertial {_pose(_find(link, "inertial/origin"))} mass="{mass}" diaginertia="{values}"/>'


def _pose(origin: ET.Element) -> str:
    roll, pitch, yaw = (float(word) / 2 for word in origin.get("rpy", "0 0 0").split())
    (sr, sp, sy), (cr, cp, cy) = (f([roll, pitch, yaw]) for f in (np.sin, np.cos))
    turn = (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
    return f'pos="{origin.get("xyz", "0 0 0")}" quat="{_numbers(turn)}"'


def _find(element: ET.Element, path: str) -> ET.Element:
    found = element.find(path)
    if found is None:
        raise SimError(f"the arm's description has a {element.tag} without {path}")
    return found


def _numbers(values: Sequence[float] | FloatArray) -> str:
    return " ".join(repr(float(value)) for value in values)
