"""ArmShape: an arm's visible shape as arrays, placed by forward kinematics, to draw it without an engine."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from layflat.data.arrays import FloatArray
from layflat.sim.errors import SimError
from layflat.sim.physics.base import Arm

ARM_RGB, HANGER_RGB = (229.5, 229.5, 229.5), (63.75, 63.75, 63.75)

_BOX_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_BOX_TRIANGLES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmShape:
    """Triangles of all links, V vertices and T triangles."""

    base_position_m: tuple[float, float, float]
    vertices: FloatArray
    """Positions, (V, 3) m, each in its link's frame."""
    link: NDArray[np.intp]
    """Link of each vertex, (V,): 0 the base, k the one that joint k moves."""
    triangles: NDArray[np.intp]
    """Vertex indices, (T, 3), counter-clockwise seen from outside."""
    is_hanger: NDArray[np.bool_]
    """Whether a triangle is part of the bar or a clip, (T,)."""
    joint_frames: FloatArray
    """Transforms from each joint's frame at zero to that of the link before, (J, 4, 4)."""

    def link_frames(self, joint_angles: FloatArray) -> FloatArray:
        """Return (J + 1, 4, 4) from each link's frame to the world; ``joint_angles`` (J,) rad about z."""
        angles = np.asarray(joint_angles, dtype=float)
        if angles.shape != (len(self.joint_frames),):
            raise SimError(f"joint angles have shape {angles.shape}; the arm has {len(self.joint_frames)} joints")
        frames = [np.eye(4)]
        frames[0][:3, 3] = self.base_position_m
        for frame, angle in zip(self.joint_frames, angles, strict=True):
            c, s = math.cos(angle), math.sin(angle)
            turn = np.array([[c, -s, 0.0, 0.0], [s, c, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
            frames.append(frames[-1] @ frame @ turn)
        return np.array(frames)

    def placed(self, joint_angles: FloatArray) -> FloatArray:
        """Return the vertices, (V, 3) m, world."""
        frames = self.link_frames(joint_angles)[self.link]
        return np.einsum("vij,vj->vi", frames[:, :3, :3], self.vertices) + frames[:, :3, 3]


class ArmSolid:
    """The arm of a world as the camera sees it."""

    def __init__(self, shape: ArmShape, arm: Arm) -> None:
        self._shape, self._arm = shape, arm
        self._colours = np.where(shape.is_hanger[:, None], HANGER_RGB, ARM_RGB)

    def mesh(self) -> tuple[FloatArray, NDArray[np.intp], FloatArray]:
        """Return vertices, triangles and colours where the arm is now."""
        return self._shape.placed(np.array(self._arm.joint_states()[0])), self._shape.triangles, self._colours


def shape_from_urdf(urdf: bytes, base_position_m: tuple[float, float, float], joints: int) -> ArmShape:
    """Return the shape of the arm in a robot description whose links are ``panda_link0`` to ``panda_link<joints>``."""
    robot = ET.fromstring(urdf)
    vertices: list[FloatArray] = []
    triangles: list[NDArray] = []
    links: list[NDArray] = []
    hanger: list[NDArray] = []
    for link in robot.findall("link"):
        number = int(link.get("name", "0").removeprefix("panda_link"))
        for visual in link.findall("visual"):
            points, faces, is_box = _shape(visual)
            triangles.append(_outward(points, faces) + sum(len(v) for v in vertices))
            vertices.append(points)
            links.append(np.full(len(points), number))
            hanger.append(np.full(len(faces), is_box))
    origins = {str(joint.get("name")): _origin(joint.find("origin")) for joint in robot.findall("joint")}
    return ArmShape(
        base_position_m=base_position_m,
        vertices=np.concatenate(vertices),
        link=np.concatenate(links),
        triangles=np.concatenate(triangles),
        is_hanger=np.concatenate(hanger),
        joint_frames=np.array([origins[f"panda_joint{k + 1}"] for k in range(joints)]),
    )


def _shape(visual: ET.Element) -> tuple[FloatArray, NDArray[np.intp], bool]:
    """Return vertices in the link's frame, triangles, and whether it is a box."""
    frame = _origin(visual.find("origin"))
    box, mesh = visual.find("geometry/box"), visual.find("geometry/mesh")
    if box is not None:
        points, faces = _BOX_CORNERS * _numbers(box.get("size")), _BOX_TRIANGLES
    elif mesh is not None:
        points, faces = _read_obj(Path(str(mesh.get("filename"))))
    else:
        raise SimError("the arm's description has a shape that is neither a box nor a mesh")
    return points @ frame[:3, :3].T + frame[:3, 3], faces, box is not None


def _read_obj(path: Path) -> tuple[FloatArray, NDArray[np.intp]]:
    lines = [line.split() for line in path.read_text().splitlines()]
    points = np.array([[float(v) for v in words[1:4]] for words in lines if words[:1] == ["v"]])
    faces = [[int(word.split("/")[0]) - 1 for word in words[1:]] for words in lines if words[:1] == ["f"]]
    fans = [(face[0], face[k], face[k + 1]) for face in faces for k in range(1, len(face) - 1)]
    # Vertices that a file repeats for each face are one: a mesh is drawn by its corners.
    unique, index = np.unique(points.round(6), axis=0, return_inverse=True)
    return unique, index.reshape(-1)[np.array(fans)]


def _outward(points: FloatArray, faces: NDArray[np.intp]) -> NDArray[np.intp]:
    """Turn faces to run counter-clockwise seen from outside: the meshes are hulls around their middle."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    inward = np.einsum("tk,tk->t", normal, (a + b + c) / 3 - points.mean(axis=0)) < 0
    return np.where(inward[:, None], faces[:, ::-1], faces)


def _origin(element: ET.Element | None) -> FloatArray:
    """Return the frame (4, 4) of an origin element; the identity without one."""
    frame = np.eye(4)
    if element is None:
        return frame
    frame[:3, :3] = Rotation.from_euler("xyz", _numbers(element.get("rpy"))).as_matrix()
    frame[:3, 3] = _numbers(element.get("xyz"))
    return frame


def _numbers(text: str | None) -> FloatArray:
    return np.array([float(word) for word in (text or "0 0 0").split()])
