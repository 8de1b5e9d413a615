"""View3d: the scene drawn without a GPU: polygons sorted from far to near, on a larger picture that is reduced."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.app.media import cloth_colors as colors
from layflat.app.media.cloth_colors import ClothPaint, Rgb
from layflat.app.workstation.window.orbit_camera import NEAR_M, OrbitCamera
from layflat.app.workstation.window.pen import SHIFT, Pen, fixed, on_table
from layflat.data.arrays import FloatArray
from layflat.sim.camera.renderer import LIGHT
from layflat.sim.cloth.mesh import MeshMaker
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.robots.arm_shape import ArmShape

MAX_FINE_PX = 1_600_000
"""Size of a view up to which pixels are drawn smaller than they are shown, for smooth edges."""
SHADOW = 0.55
AMBIENT, DIFFUSE = 0.42, 0.68
FORCE_M_PER_N = 0.06
"""Length of a force's arrow."""
GUIDE_RGB = (255, 196, 0)
AXIS_M = 0.12
AXIS_PLACE_M = np.array([-0.25, -0.42, 0.002])
"""Foot of the axis arrows, on the table."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """Everything that is drawn at one moment; world frame, m and N."""

    nodes: FloatArray
    """Cloth, (N, 3)."""
    corners: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    """Held corners, (2, 3)."""
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
    ghost: FloatArray | None = None
    """Nodes of a demonstration that is shown beside the cloth, (N, 3)."""


def axis_heads() -> list[tuple[str, Rgb, FloatArray]]:
    """Return the name, the colour and the place, (3,) m, of the head of each axis arrow."""
    heads = AXIS_PLACE_M + 1.6 * AXIS_M * np.eye(3)
    return list(zip(colors.AXIS_NAMES, colors.AXES, heads, strict=True))


class View3d:
    """Draws scenes of one cloth and, if there is one, one arm."""

    def __init__(self, cloth: ClothSpec, arm: ArmShape | None) -> None:
        self._meshes = MeshMaker(cloth, subdivisions=2)
        self._paint = ClothPaint(cloth, subdivisions=2)
        self._grid = (cloth.rows, cloth.columns)
        self._arm = arm
        self._ground: tuple[tuple[OrbitCamera, tuple[int, int]], NDArray[np.uint8]] | None = None

    def draw(self, scene: Scene, camera: OrbitCamera, size: tuple[int, int], scale: float = 1.0) -> NDArray[np.uint8]:
        """Return a picture of ``size`` (width, height) px as (height, width, 3) uint8."""
        fine = 2 if size[0] * size[1] <= MAX_FINE_PX else 1
        big = (size[0] * fine, size[1] * fine)
        pen = Pen(self._background(camera, big, scale * fine).copy(), camera, scale * fine)
        arm = None if self._arm is None or scene.joints is None else self._arm.placed(scene.joints)
        mesh = self._meshes.mesh(scene.nodes)
        self._shadows(pen, scene, arm)
        face, reverse = self._paint.colors(mesh.vertices)
        shapes = [_shaded(mesh.vertices, mesh.triangles, camera, big, (face, reverse), normals=mesh.normals)]
        if self._arm is not None and arm is not None:
            for part, rgb in ((~self._arm.is_hanger, colors.ARM), (self._arm.is_hanger, colors.HOLDER)):
                shapes.append(_shaded(arm, self._arm.triangles[part], camera, big, (np.array(rgb, float), None)))
        _fill(pen.picture, shapes)
        for a, b in self._paint.fold_lines(mesh):
            pen.line(a, b, colors.FOLD_RIM, 5)
        for a, b in self._paint.fold_lines(mesh):
            pen.line(a, b, colors.FOLD, 2.5)
        for axis, rgb in zip(np.eye(3), colors.AXES, strict=True):
            pen.arrow(AXIS_PLACE_M, AXIS_PLACE_M + AXIS_M * axis, rgb, 2)
        self._draw_marks(pen, scene)
        if fine == 1:
            return pen.picture
        return np.ascontiguousarray(cv2.resize(pen.picture, size, interpolation=cv2.INTER_AREA))

    def _background(self, camera: OrbitCamera, size: tuple[int, int], scale: float) -> NDArray[np.uint8]:
        """Return room and table: the same picture until the camera moves."""
        if self._ground is None or self._ground[0] != (camera, size):
            pen = Pen(np.full((size[1], size[0], 3), colors.ROOM, np.uint8), camera, scale)
            pen.ground()
            self._ground = ((camera, size), pen.picture)
        return self._ground[1]

    def _shadows(self, pen: Pen, scene: Scene, arm: FloatArray | None) -> None:
        """Darken the table below cloth and arm; soft, and at a quarter of the size."""
        picture, camera = pen.picture, pen.camera
        quarter = (picture.shape[1] // 4, picture.shape[0] // 4)
        mask = np.zeros((quarter[1], quarter[0]), np.uint8)
        grid = np.arange(len(scene.nodes)).reshape(self._grid)
        quads = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=-1).reshape(-1, 4)
        cast, depth = camera.project(on_table(scene.nodes), quarter)
        if depth.min() > NEAR_M:
            for corners in fixed(cast[quads]):
                cv2.fillConvexPoly(mask, cv2.convexHull(corners), 255, cv2.LINE_8, SHIFT)
        if arm is not None and self._arm is not None:
            cast, depth = camera.project(on_table(arm), quarter)
            for link in range(1, int(self._arm.link.max()) + 1):
                own = self._arm.link == link
                if depth[own].min() > NEAR_M:
                    cv2.fillConvexPoly(mask, cv2.convexHull(fixed(cast[own])), 255, cv2.LINE_8, SHIFT)
        x, y, wide, high = cv2.boundingRect(mask)
        if not wide:
            return
        margin = 12
        x0, y0 = max(x - margin, 0), max(y - margin, 0)
        x1, y1 = min(x + wide + margin, quarter[0]), min(y + high + margin, quarter[1])
        soft = cv2.GaussianBlur(mask[y0:y1, x0:x1], (0, 0), 2.5)
        part = picture[4 * y0 : 4 * y1, 4 * x0 : 4 * x1]
        cover = cv2.resize(soft, (part.shape[1], part.shape[0]), interpolation=cv2.INTER_LINEAR)
        dim = cv2.convertScaleAbs(cover, alpha=-(1 - SHADOW), beta=255.0)
        # The blur spills over the table's edge by a pixel or two, where the picture is dark anyway.
        part[:] = cv2.multiply(part, cv2.merge([dim, dim, dim]), scale=1 / 255)

    def _draw_marks(self, pen: Pen, scene: Scene) -> None:
        """Draw ghost, held corners, hands, drag, guiding hand and force over everything else."""
        if scene.ghost is not None:
            rim = scene.ghost.reshape(*self._grid, 3)
            outline = np.concatenate([rim[0], rim[1:, -1], rim[-1, -2::-1], rim[-2::-1, 0]])
            pen.path(outline, colors.GHOST, 1.5)
        for centres, radius_m, rgb in ((scene.corners, 0.009, colors.HOLDER), (scene.hands, 0.008, colors.HAND)):
            for centre in centres:
                pen.ball(centre, radius_m, rgb)
        at = scene.hands.mean(axis=0) if len(scene.hands) else None
        for pair, rgb in ((scene.drag, colors.HAND), (scene.guided, GUIDE_RGB)):
            if pair is not None:
                pen.line(*pair, rgb, 2)
                pen.ring(pair[1], 9, rgb, 2)
        if scene.drag is not None:
            at = scene.drag[0]
            pen.ball(at, 0.009, colors.HAND)
        elif scene.hover is not None:
            pen.ring(scene.hover, 8, (255, 255, 255), 1)
        if np.linalg.norm(scene.force_n) > 0.02:
            start = scene.nodes.mean(axis=0) if at is None else at
            pen.arrow(start, start + FORCE_M_PER_N * scene.force_n, colors.HAND, 3)


_Shape = tuple[NDArray[np.int32], FloatArray, FloatArray]
"""Corners (T, 3, 2) in drawing coordinates, depths (T,) and colours (T, 3) of triangles."""


def _shaded(
    vertices: FloatArray,
    triangles: NDArray,
    camera: OrbitCamera,
    size: tuple[int, int],
    rgb: tuple[FloatArray, FloatArray | None],
    *,
    normals: FloatArray | None = None,
) -> _Shape:
    """Return the visible triangles; ``rgb``, (3,) or (T, 3), of faces and of backs, which are left out without."""
    pixels, depth = camera.project(vertices, size)
    corner = pixels[triangles]
    u, v = corner[..., 0], corner[..., 1]
    # The image's v runs down, so a triangle that faces the eye has a negative area.
    front = (u[:, 1] - u[:, 0]) * (v[:, 2] - v[:, 0]) - (u[:, 2] - u[:, 0]) * (v[:, 1] - v[:, 0]) < 0
    seen = depth[triangles].min(axis=1) > NEAR_M
    face, back = rgb
    base = np.broadcast_to(face if back is None else np.where(front[:, None], face, back), (len(triangles), 3))
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
    return fixed(corner[seen]), depth[triangles].mean(axis=1), np.clip(base[seen] * bright[:, None], 0, 255)


def _fill(picture: NDArray[np.uint8], shapes: list[_Shape]) -> None:
    """Draw all triangles, the farthest first."""
    corners = np.concatenate([shape[0] for shape in shapes])
    order = np.argsort(-np.concatenate([shape[1] for shape in shapes]), kind="stable")
    rgb = np.concatenate([shape[2] for shape in shapes])[order].tolist()
    for triangle, color in zip(corners[order], rgb, strict=True):
        cv2.fillConvexPoly(picture, triangle, color, cv2.LINE_8, SHIFT)
