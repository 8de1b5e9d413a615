"""View3d: the scene drawn without a GPU: polygons sorted from far to near, filled at twice the size and reduced."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.app.workstation.window.orbit_camera import NEAR_M, OrbitCamera
from layflat.data.arrays import FloatArray
from layflat.sim.camera.renderer import LIGHT
from layflat.sim.cloth.mesh import MeshMaker
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.physics.base import TABLE_CENTRE_M, TABLE_SIZE_M
from layflat.sim.robots.arm_shape import ArmShape

FINE = 2
"""Factor by which pixels are drawn smaller than they are shown, for smooth edges."""
_SHIFT = 4
"""Fractional bits of drawing coordinates."""
FACE_RGB = np.array([72.0, 136.0, 240.0])
REVERSE_RGB = np.array([38.0, 84.0, 168.0])
ARM_RGB = np.array([214.0, 219.0, 226.0])
HANGER_RGB = np.array([70.0, 76.0, 88.0])
TABLE_RGB = (50, 58, 70)
TABLE_EDGE_RGB = (36, 42, 52)
GRID_RGB = (63, 73, 88)
AXIS_RGB = (92, 104, 122)
SKY_TOP, SKY_BOTTOM = np.array([24.0, 29.0, 38.0]), np.array([33.0, 40.0, 51.0])
PICKER_RGB = (255, 148, 64)
HAND_RGB = (255, 96, 112)
GUIDE_RGB = (255, 196, 0)
GRID_M = 0.1
SHADOW = 0.55
AMBIENT, DIFFUSE = 0.36, 0.74


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """Everything that is drawn at one moment; world frame, m and N."""

    nodes: FloatArray
    """Cloth, (N, 3)."""
    corners: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    """Pickers, (2, 3); none where an arm holds the cloth."""
    joints: FloatArray | None = None
    """Angles of the arm where there is one, (J,) rad."""
    hands: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    """Places where a disturbance holds the cloth, (K, 3)."""
    force_n: FloatArray = field(default_factory=lambda: np.zeros(3))
    """Mean force on the cloth, (3,)."""
    drag: tuple[FloatArray, FloatArray] | None = None
    """Dragged node and its target, each (3,)."""
    guided: tuple[FloatArray, FloatArray] | None = None
    """Place that a hand guides and the place of the hand, each (3,)."""
    hover: FloatArray | None = None
    """Node that a click would grab, (3,)."""


class View3d:
    """Draws scenes of one cloth and, if there is one, one arm."""

    def __init__(self, cloth: ClothSpec, arm: ArmShape | None) -> None:
        self._meshes = MeshMaker(cloth, subdivisions=2)
        self._grid = (cloth.rows, cloth.columns)
        self._arm = arm
        self._ground: tuple[tuple[OrbitCamera, tuple[int, int]], NDArray[np.uint8]] | None = None

    def draw(self, scene: Scene, camera: OrbitCamera, size: tuple[int, int]) -> NDArray[np.uint8]:
        """Return a picture of ``size`` (width, height) px as (height, width, 3) uint8."""
        big = (size[0] * FINE, size[1] * FINE)
        canvas = self._background(camera, big).copy()
        arm = None if self._arm is None or scene.joints is None else self._arm.placed(scene.joints)
        mesh = self._meshes.mesh(scene.nodes)
        self._shadows(canvas, scene, arm, camera)
        shapes = [_shaded(mesh.vertices, mesh.triangles, camera, big, (FACE_RGB, REVERSE_RGB), normals=mesh.normals)]
        if self._arm is not None and arm is not None:
            for part, rgb in ((~self._arm.is_hanger, ARM_RGB), (self._arm.is_hanger, HANGER_RGB)):
                shapes.append(_shaded(arm, self._arm.triangles[part], camera, big, (rgb, None)))
        _fill(canvas, shapes)
        _draw_marks(canvas, scene, camera, big)
        return np.ascontiguousarray(cv2.resize(canvas, size, interpolation=cv2.INTER_AREA))

    def _background(self, camera: OrbitCamera, size: tuple[int, int]) -> NDArray[np.uint8]:
        """Return sky and table: the same picture until the camera moves."""
        if self._ground is None or self._ground[0] != (camera, size):
            self._ground = ((camera, size), _ground(camera, size))
        return self._ground[1]

    def _shadows(self, canvas: NDArray[np.uint8], scene: Scene, arm: FloatArray | None, camera: OrbitCamera) -> None:
        """Darken the table below cloth and arm; soft, and at a quarter of the size."""
        quarter = (canvas.shape[1] // 4, canvas.shape[0] // 4)
        mask = np.zeros((quarter[1], quarter[0]), np.uint8)
        grid = np.arange(len(scene.nodes)).reshape(self._grid)
        quads = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=-1).reshape(-1, 4)
        cast, depth = camera.project(_on_table(scene.nodes), quarter)
        if depth.min() > NEAR_M:
            for corners in _fixed(cast[quads]):
                cv2.fillConvexPoly(mask, cv2.convexHull(corners), 255, cv2.LINE_8, _SHIFT)
        if arm is not None and self._arm is not None:
            cast, depth = camera.project(_on_table(arm), quarter)
            for link in range(1, int(self._arm.link.max()) + 1):
                own = self._arm.link == link
                if depth[own].min() > NEAR_M:
                    cv2.fillConvexPoly(mask, cv2.convexHull(_fixed(cast[own])), 255, cv2.LINE_8, _SHIFT)
        x, y, wide, high = cv2.boundingRect(mask)
        if not wide:
            return
        margin = 12
        x0, y0 = max(x - margin, 0), max(y - margin, 0)
        x1, y1 = min(x + wide + margin, quarter[0]), min(y + high + margin, quarter[1])
        soft = cv2.GaussianBlur(mask[y0:y1, x0:x1], (0, 0), 2.5)
        part = canvas[4 * y0 : 4 * y1, 4 * x0 : 4 * x1]
        cover = cv2.resize(soft, (part.shape[1], part.shape[0]), interpolation=cv2.INTER_LINEAR)
        dim = cv2.convertScaleAbs(cover, alpha=-(1 - SHADOW), beta=255.0)
        # The blur spills over the table's edge by a pixel or two, where the picture is dark anyway.
        part[:] = cv2.multiply(part, cv2.merge([dim, dim, dim]), scale=1 / 255)


def _on_table(points: FloatArray) -> FloatArray:
    """Return where the light through ``points`` meets the table."""
    cast: FloatArray = points - np.maximum(points[:, 2:], 0.0) / LIGHT[2] * LIGHT
    return np.clip(cast, _table_box()[0], _table_box()[1])


def _table_box() -> tuple[FloatArray, FloatArray]:
    half = np.array([TABLE_SIZE_M[0] / 2, TABLE_SIZE_M[1] / 2, 0.0])
    centre = np.array([*TABLE_CENTRE_M, 0.0])
    return centre - half, centre + half


def _fixed(pixels: FloatArray) -> NDArray[np.int32]:
    """Return drawing coordinates, clipped far outside the picture, where OpenCV's integers would overflow."""
    fixed: NDArray[np.int32] = np.rint(np.clip(pixels, -8000, 12000) * 2**_SHIFT).astype(np.int32)
    return fixed


_Shape = tuple[NDArray[np.int32], FloatArray, FloatArray]
"""Corners (T, 3, 2) in drawing coordinates, depths (T,) and colors (T, 3) of triangles."""


def _shaded(
    vertices: FloatArray,
    triangles: NDArray,
    camera: OrbitCamera,
    size: tuple[int, int],
    colors: tuple[FloatArray, FloatArray | None],
    *,
    normals: FloatArray | None = None,
) -> _Shape:
    """Return the visible triangles; without a color for their backs, those are left out."""
    pixels, depth = camera.project(vertices, size)
    corner = pixels[triangles]
    u, v = corner[..., 0], corner[..., 1]
    # The image's v runs down, so a triangle that faces the eye has a negative area.
    front = (u[:, 1] - u[:, 0]) * (v[:, 2] - v[:, 0]) - (u[:, 2] - u[:, 0]) * (v[:, 1] - v[:, 0]) < 0
    seen = depth[triangles].min(axis=1) > NEAR_M
    face, back = colors
    if back is None:
        seen &= front
    triangles, front = triangles[seen], front[seen]
    if normals is None:
        a, b, c = (vertices[triangles[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    else:
        normal = normals[triangles].mean(axis=1)
    # The light falls on the side that is seen, and a little comes from the eye.
    turned = np.where(front, 1.0, -1.0)
    light = np.clip(turned * (normal @ LIGHT), 0.0, 1.0)
    eye = np.clip(turned * (normal @ camera.axes()[2]), 0.0, 1.0)
    bright = AMBIENT + DIFFUSE * (0.65 * light + 0.35 * eye)
    base = face if back is None else np.where(front[:, None], face, back)
    return _fixed(corner[seen]), depth[triangles].mean(axis=1), np.clip(base * bright[:, None], 0, 255)


def _fill(canvas: NDArray[np.uint8], shapes: list[_Shape]) -> None:
    """Draw all triangles, the farthest first."""
    corners = np.concatenate([shape[0] for shape in shapes])
    order = np.argsort(-np.concatenate([shape[1] for shape in shapes]), kind="stable")
    colors = np.concatenate([shape[2] for shape in shapes])[order].tolist()
    for triangle, color in zip(corners[order], colors, strict=True):
        cv2.fillConvexPoly(canvas, triangle, color, cv2.LINE_8, _SHIFT)


def _ground(camera: OrbitCamera, size: tuple[int, int]) -> NDArray[np.uint8]:
    """Draw sky, table and its grid, with x = 0 and y = 0 brighter."""
    share = np.linspace(0.0, 1.0, size[1])[:, None]
    column = np.rint(SKY_TOP + (SKY_BOTTOM - SKY_TOP) * share).astype(np.uint8)
    picture = np.repeat(column[:, None], size[0], axis=1)
    low, high = _table_box()
    top = np.array([[low[0], low[1], 0], [high[0], low[1], 0], [high[0], high[1], 0], [low[0], high[1], 0]])
    for depth_m, rgb in ((TABLE_SIZE_M[2] / 2, TABLE_EDGE_RGB), (0.0, TABLE_RGB)):
        _plane(picture, top - [0, 0, depth_m], camera, size, rgb)
    for axis in (0, 1):
        for at in np.arange(np.ceil(low[axis] / GRID_M), high[axis] / GRID_M + 1e-9) * GRID_M:
            ends = np.array([low, high])
            ends[:, axis] = at
            _line(picture, ends, camera, size, AXIS_RGB if abs(at) < 1e-9 else GRID_RGB)
    return picture


def _plane(
    picture: NDArray[np.uint8], corners: FloatArray, camera: OrbitCamera, size: tuple[int, int], rgb: tuple
) -> None:
    """Draw a convex polygon, cut where it is behind the eye."""
    points = _clipped(np.vstack([corners, corners[:1]]), camera)
    if len(points) >= 3:
        pixels = camera.project(points, size)[0]
        cv2.fillConvexPoly(picture, cv2.convexHull(_fixed(pixels)), rgb, cv2.LINE_AA, _SHIFT)


def _line(picture: NDArray[np.uint8], ends: FloatArray, camera: OrbitCamera, size: tuple[int, int], rgb: tuple) -> None:
    points = _clipped(ends, camera)
    if len(points) >= 2:
        a, b = _fixed(camera.project(points[[0, -1]], size)[0]).tolist()
        cv2.line(picture, a, b, rgb, FINE, cv2.LINE_AA, _SHIFT)


def _clipped(path: FloatArray, camera: OrbitCamera) -> FloatArray:
    """Return the path (K, 3) without points behind NEAR_M, and with points where it crosses that plane."""
    depth = (camera.eye() - path) @ camera.axes()[2] - NEAR_M
    kept: list[FloatArray] = []
    for k in range(len(path)):
        if k and (depth[k] > 0) != (depth[k - 1] > 0):
            share = depth[k - 1] / (depth[k - 1] - depth[k])
            kept.append(path[k - 1] + share * (path[k] - path[k - 1]) + 1e-6)
        if depth[k] > 0:
            kept.append(path[k])
    return np.array(kept).reshape(-1, 3)


FORCE_M_PER_N = 0.06
"""Length of a force's arrow."""


def _draw_marks(canvas: NDArray[np.uint8], scene: Scene, camera: OrbitCamera, size: tuple[int, int]) -> None:
    """Draw pickers, hands, drag, guiding hand and force over everything else."""
    for centres, radius_m, rgb in ((scene.corners, 0.009, PICKER_RGB), (scene.hands, 0.008, HAND_RGB)):
        for centre in centres:
            _ball(canvas, centre, radius_m, camera, size, rgb)
    at = scene.hands.mean(axis=0) if len(scene.hands) else None
    for pair, rgb in ((scene.drag, HAND_RGB), (scene.guided, GUIDE_RGB)):
        if pair is not None:
            a, b = _fixed(camera.project(pair, size)[0]).tolist()
            cv2.line(canvas, a, b, rgb, FINE * 2, cv2.LINE_AA, _SHIFT)
            cv2.circle(canvas, b, FINE * 9 << _SHIFT, rgb, FINE * 2, cv2.LINE_AA, _SHIFT)
    if scene.drag is not None:
        at = scene.drag[0]
        _ball(canvas, at, 0.009, camera, size, HAND_RGB)
    elif scene.hover is not None:
        place = _fixed(camera.project(scene.hover, size)[0])[0].tolist()
        cv2.circle(canvas, place, FINE * 8 << _SHIFT, (255, 255, 255), FINE, cv2.LINE_AA, _SHIFT)
    if np.linalg.norm(scene.force_n) > 0.02:
        start = scene.nodes.mean(axis=0) if at is None else at
        _arrow(canvas, start, start + FORCE_M_PER_N * scene.force_n, camera, size)


def _ball(
    canvas: NDArray[np.uint8],
    centre: FloatArray,
    radius_m: float,
    camera: OrbitCamera,
    size: tuple[int, int],
    rgb: tuple,
) -> None:
    pixel, depth = camera.project(centre, size)
    if depth[0] < NEAR_M:
        return
    radius = max(2 * FINE, round(radius_m / depth[0] * size[1] * 1.45))
    x, y = _fixed(pixel)[0].tolist()
    dark = tuple(int(0.55 * value) for value in rgb)
    cv2.circle(canvas, (x, y), radius << _SHIFT, dark, -1, cv2.LINE_AA, _SHIFT)
    lift = int(0.22 * radius) << _SHIFT
    cv2.circle(canvas, (x + lift // 2, y - lift), int(0.72 * radius) << _SHIFT, rgb, -1, cv2.LINE_AA, _SHIFT)


def _arrow(
    canvas: NDArray[np.uint8], tail: FloatArray, head: FloatArray, camera: OrbitCamera, size: tuple[int, int]
) -> None:
    (a, b), depth = camera.project([tail, head], size)
    if depth.min() < NEAR_M or np.linalg.norm(b - a) < 2 * FINE:
        return
    tip = min(0.45, 12 * FINE / float(np.linalg.norm(b - a)))
    start, end = (np.rint(p).astype(int).tolist() for p in (a, b))
    cv2.arrowedLine(canvas, start, end, HAND_RGB, FINE * 3, cv2.LINE_AA, 0, tip)
