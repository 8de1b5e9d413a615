"""Exports episodes to Rerun: the camera's images in their place, the cloth, the robot and curves, as .rrd files."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from layflat.data.atomic_files import atomic_path
from layflat.data.errors import DataError
from layflat.data.exchange.optional_imports import require
from layflat.data.format import schema
from layflat.data.format.opening import errors_name
from layflat.data.format.structure_checks import mesh_shape_of
from layflat.data.session.reader import Session
from layflat.data.types import ACTION_LIMIT_M

APPLICATION = "layflat"
CLOTH_RGB, CORNER_RGB, HOLDER_RGB, WORD_RGB = (60, 130, 220), (240, 130, 30), (120, 120, 120), (220, 60, 60)
ARROW_M = 0.1
"""Length of WORD's arrow."""
RADIUS_M = 0.006
WORD_LIFT_M = (0.0, 0.0, 0.02)
CURVES = {
    "contact/camera": "contact_portion",
    "contact/true": schema.CONTACT_TRUE,
    "contact/flat_area": schema.FLAT_AREA,
    "word_strength": "word_strength",
}
"""Entity under ``curves`` and the data set that it shows."""


def export_rerun(
    session: Session,
    folder: Path,
    *,
    names: Iterable[str] | None = None,
    images: bool = True,
    on_episode: Callable[[str], None] | None = None,
) -> int:
    """Write ``demo_K.rrd`` for each episode into ``folder``, which is created; return the number of files."""
    rr = require("rerun")
    chosen = tuple(session.names if names is None else names)
    if not chosen:
        raise DataError(f"no episodes of {session.path} were chosen; there is nothing to export")
    folder.mkdir(parents=True, exist_ok=True)
    for name in chosen:
        with atomic_path(folder / f"{name}.rrd") as aside:
            recording = rr.RecordingStream(APPLICATION, recording_id=session.info(name).uid)
            recording.save(aside, default_blueprint=_blueprint())
            with errors_name(session.path):
                _log_episode(rr, recording, session, name, images=images)
            recording.flush()
            recording.disconnect()
        if on_episode is not None:
            on_episode(name)
    return len(chosen)


def _log_episode(rr: Any, to: Any, session: Session, name: str, *, images: bool) -> None:
    info, attributes = session.info(name), session.attributes(name)
    rows = session.rows(name, images=images)
    about = [f"- {key}: {value}" for key, value in vars(info).items() if key != schema.ACTION_AXES]
    to.send_recording_name(f"{session.path.name} {name} ({info.outcome})")
    to.log("about", rr.TextDocument("\n".join([f"# {name}", "", *about]), media_type="text/markdown"), static=True)
    to.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    _log_camera(rr, to, session, name)
    triangles = _triangles(mesh_shape_of(attributes))
    phases = [phase.decode() for phase in rows[schema.PHASE]]
    for index, time in enumerate(rows["time_s"][:, 0].tolist()):
        to.set_time("step", sequence=index)
        to.set_time("time", duration=time)
        _log_scene(rr, to, rows, index, triangles)
        for entity, key in CURVES.items():
            if key in rows:
                to.log(f"curves/{entity}", rr.Scalars(rows[key][index, 0]))
        if index < len(phases):
            actions = zip(session.robot.action_names, rows[schema.ACTION_M][index].tolist(), strict=True)
            for axis, value in actions:
                to.log(f"curves/action/{axis}", rr.Scalars(value / ACTION_LIMIT_M))
            if index == 0 or phases[index] != phases[index - 1]:
                to.log("phase", rr.TextLog(phases[index]))


def _log_camera(rr: Any, to: Any, session: Session, name: str) -> None:
    camera = session.camera_of(name)
    if camera is None:
        return
    pose = camera.cam_to_world
    to.log("world/camera", rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]), static=True)
    pinhole = rr.Pinhole(
        focal_length=(camera.fx, camera.fy),
        principal_point=(camera.cx + 0.5, camera.cy + 0.5),  # Rerun counts from the image's corner.
        width=camera.width,
        height=camera.height,
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=0.2,
    )
    to.log("world/camera", pinhole, static=True)


def _log_scene(rr: Any, to: Any, rows: Mapping[str, NDArray[Any]], index: int, triangles: NDArray[Any] | None) -> None:
    corners = rows["corner_positions"][index].reshape(2, 3)
    to.log("world/corners", rr.Points3D(corners, radii=RADIUS_M, colors=CORNER_RGB))
    to.log("world/holder", rr.Points3D(rows["holder_position"][index], radii=RADIUS_M, colors=HOLDER_RGB))
    middle = corners.mean(axis=0)
    if schema.STATES in rows:
        nodes = rows[schema.STATES][index].reshape(-1, 3)
        middle = nodes.mean(axis=0)
        if triangles is None:
            to.log("world/cloth", rr.Points3D(nodes, radii=RADIUS_M / 2, colors=CLOTH_RGB))
        else:
            colors = np.full((len(nodes), 3), CLOTH_RGB, np.uint8)
            to.log("world/cloth", rr.Mesh3D(vertex_positions=nodes, triangle_indices=triangles, vertex_colors=colors))
    word = np.append(rows["word"][index], 0.0) * ARROW_M
    to.log("world/word", rr.Arrows3D(origins=middle + WORD_LIFT_M, vectors=word, colors=WORD_RGB))
    if schema.RGB in rows:
        to.log("world/camera/rgb", rr.EncodedImage(contents=_png(rows[schema.RGB][index]), media_type="image/png"))
    if schema.DEPTH in rows:
        to.log("world/camera/depth", rr.DepthImage(rows[schema.DEPTH][index, ..., 0], meter=1.0))


def _triangles(shape: tuple[int, int] | None) -> NDArray[np.int64] | None:
    """Return two triangles for each cell of the mesh, (T, 3); None where its shape is not known."""
    if shape is None:
        return None
    grid = np.arange(shape[0] * shape[1]).reshape(shape)
    a, b, c, d = (cell.ravel() for cell in (grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:]))
    return np.concatenate([np.column_stack([a, b, c]), np.column_stack([b, d, c])])


def _png(image: NDArray[np.uint8]) -> bytes:
    packed = io.BytesIO()
    require("PIL.Image").fromarray(image).save(packed, "PNG", compress_level=1)
    return packed.getvalue()


def _blueprint() -> Any:
    rrb = require("rerun.blueprint")
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Tabs(
                # Points of the depth would hide the cloth.
                rrb.Spatial3DView(origin="world", name="Scene", contents=["+ $origin/**", "- $origin/camera/depth"]),
                rrb.Spatial3DView(origin="world", name="Scene with depth"),
            ),
            rrb.Vertical(
                rrb.Tabs(
                    rrb.Spatial2DView(origin="world/camera/rgb", name="Camera"),
                    rrb.Spatial2DView(origin="world/camera/depth", name="Depth"),
                ),
                rrb.TimeSeriesView(origin="curves/contact", name="Contact"),
                rrb.TimeSeriesView(origin="curves/action", name="Action, shares of the limit"),
                rrb.TextDocumentView(origin="about", name="About"),
            ),
        ),
        collapse_panels=True,
    )
