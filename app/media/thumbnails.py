"""Thumbnails: small pictures of how an episode ends, fast enough for a page of many."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.app.media import cloth_colors
from layflat.app.media.cloth_colors import ClothPaint
from layflat.app.media.png import png_bytes
from layflat.data.arrays import FloatArray
from layflat.data.camera import CameraModel
from layflat.data.format import schema
from layflat.data.format.structure_checks import camera_of, mesh_shape_of
from layflat.data.session.reader import Session
from layflat.sim.cloth.registry import CLOTHS, cloth_spec
from layflat.sim.cloth.spec import DEFAULT_CLOTH

WIDTH = 160
"""Width of a thumbnail, px; it is 4:3."""
VIEW_M = 0.62
"""Length of the table that is shown where no camera is known: from above, away from the robot upwards."""
ZOOM = 2.0
"""Enlargement about the cloth of what the camera sees."""
_KNOWN: dict[tuple[str, str, int], bytes] = {}
"""Thumbnails by identity, content and width of the episode: 20 kB at most each."""


def thumbnail(session: Session, name: str, *, width: int = WIDTH) -> bytes:
    """Return the last moment of an episode, edits applied, as PNG bytes.

    The recorded camera image where one was kept, else the cloth's nodes drawn as the camera sees them, nearer: face
    checked, reverse orange, what rests on the table darker. An episode with neither is a plain picture. About 10 ms.
    """
    key = session.info(name).uid, session.contents([name])[name], width
    if key not in _KNOWN:
        _KNOWN[key] = _drawn(session, name, width)
    return _KNOWN[key]


def _drawn(session: Session, name: str, width: int) -> bytes:
    height = width * 3 // 4
    key = f"{schema.NEXT_OBS}/{schema.RGB}"
    if session.row_shape(name, key) is not None:
        image = session.array(name, key)[-1]
        return png_bytes(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA))
    canvas = np.full((2 * height, 2 * width, 3), cloth_colors.TABLE, np.uint8)
    attributes = session.attributes(name)
    shape = mesh_shape_of(attributes)
    if session.info(name).flat_area_final is not None and shape is not None:
        nodes = session.array(name, schema.FINAL_STATE).reshape(-1, 3)
        _draw_cloth(canvas, nodes, shape, session.cloth, camera_of(attributes))
    return png_bytes(cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False))


def _draw_cloth(
    canvas: NDArray[np.uint8], nodes: FloatArray, shape: tuple[int, int], cloth: str, camera: CameraModel | None
) -> None:
    """Fill the cloth's triangles, the farthest first."""
    spec = replace(cloth_spec(cloth if cloth in CLOTHS else DEFAULT_CLOTH), rows=shape[0], columns=shape[1])
    paint = ClothPaint(spec, subdivisions=1)
    pixels, distance = _projected(nodes, camera, canvas.shape[1], canvas.shape[0])
    face, reverse = paint.colors(nodes)
    corners = pixels[paint.triangles]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normals = np.cross(
        nodes[paint.triangles[:, 1]] - nodes[paint.triangles[:, 0]],
        nodes[paint.triangles[:, 2]] - nodes[paint.triangles[:, 0]],
    )
    # The image's rows go down: seen from the front, corners that go round to the left go round to the right there.
    turns_left = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0] < 0
    tilt = np.abs(normals[:, 2]) / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
    colors = np.where(turns_left[:, None], face, reverse) * (0.6 + 0.4 * tilt[:, None])
    for number in np.argsort(-distance[paint.triangles].mean(axis=1)):
        points = np.round(corners[number] * 16).astype(np.int32)
        cv2.fillConvexPoly(canvas, points, colors[number].tolist(), cv2.LINE_AA, 4)


def _projected(nodes: FloatArray, camera: CameraModel | None, width: int, height: int) -> tuple[FloatArray, FloatArray]:
    """Return pixels (N, 2) and distances (N,) of nodes (N, 3) m."""
    if camera is None:
        middle, scale = nodes[:, :2].mean(axis=0), height / VIEW_M
        right, down = -(nodes[:, 1] - middle[1]), -(nodes[:, 0] - middle[0])
        return np.stack([width / 2 + scale * right, height / 2 + scale * down], axis=1), -nodes[:, 2]
    x, y, z = ((nodes - camera.cam_to_world[:3, 3]) @ camera.cam_to_world[:3, :3]).T
    z = np.maximum(z, 0.01)
    columns, rows = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
    pixels = np.stack([columns * width / camera.width, rows * height / camera.height], axis=1)
    middle = (pixels.min(axis=0) + pixels.max(axis=0)) / 2
    return (width / 2, height / 2) + ZOOM * (pixels - middle), z
