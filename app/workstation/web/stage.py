"""Table, light and axes of the browser's scene, and the views of its camera."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from viser import ClientHandle, SceneApi, ViserServer

from layflat.app.media.cloth_colors import AXES, AXIS_NAMES, GRID, ROOM, TABLE
from layflat.sim.camera.renderer import LIGHT
from layflat.sim.physics.base import TABLE_CENTRE_M, TABLE_SIZE_M

Point: TypeAlias = tuple[float, float, float]

TOP_M, SHADOW_M, LINE_M = -0.0025, -0.0015, -0.0008
"""Heights at which the table's top, shadows and lines on it are drawn: what is above them does not flicker."""
GRID_M = 0.1
AXES_AT_M, AXIS_LENGTH_M = (-0.42, -0.62, 0.0), 0.14
FIELD_RAD = math.radians(38)
CENTRE: Point = (0.18, 0.04, 0.26)
"""What the camera looks at."""
VIEWS: Mapping[str, Point] = {
    "Reset": (1.36, -1.36, 0.95),
    "Side": (0.18, -1.9, 0.30),
    "Top": (0.18, 0.038, 1.75),
    "Front": (2.0, 0.04, 0.45),
}
"""Places of the camera by the label of their button."""


def look_from(client: ClientHandle, view: str, offset_m: Point = (0.0, 0.0, 0.0), farther: float = 1.0) -> None:
    """Move a viewer's camera to one of VIEWS; ``offset_m``: middle between scenes side by side."""
    with client.atomic():
        client.camera.up_direction = (0.0, 0.0, 1.0)
        client.camera.position = np.add(CENTRE, offset_m) + farther * np.subtract(VIEWS[view], CENTRE)
        client.camera.look_at = np.add(CENTRE, offset_m)


def add_stage(server: ViserServer) -> None:
    """Set the first view, and add background and light, once for all tables."""
    server.initial_camera.position = np.array(VIEWS["Reset"])
    server.initial_camera.look_at = np.array(CENTRE)
    server.initial_camera.fov = FIELD_RAD
    scene = server.scene
    scene.set_background_image(np.full((4, 4, 3), ROOM, np.uint8), format="png")
    scene.configure_environment_map(None)
    scene.configure_default_lights(enabled=False)
    scene.world_axes.visible = False
    scene.add_light_ambient("/light/ambient", intensity=1.5)
    scene.add_light_directional("/light/sun", intensity=1.9, position=tuple(3 * LIGHT))
    # A weak light from the other side: the reverse of a hanging cloth is not black.
    scene.add_light_directional("/light/fill", intensity=0.8, position=(-1.0, -2.0, 1.5))


def add_table(scene: SceneApi, parent: str) -> None:
    """Add table, grid and named axes below the node ``parent``."""
    wide, deep, thick = TABLE_SIZE_M
    x, y = TABLE_CENTRE_M
    scene.add_box(f"{parent}/table", TABLE, TABLE_SIZE_M, position=(x, y, TOP_M - thick / 2), cast_shadow=False)
    # Lines, since a grid's shader works on each pixel of the table, which takes long without a GPU.
    half = np.array((wide, deep)) / 2
    low, high = np.subtract((x, y), half), np.add((x, y), half)
    for every, width in ((1, 0.8), (5, 1.8)):
        lines = []
        for axis in (0, 1):
            for k in range(int(np.ceil(low[axis] / GRID_M)), int(high[axis] / GRID_M + 1e-9) + 1):
                if k % every == 0:
                    line = np.array([[*low, LINE_M], [*high, LINE_M]])
                    line[:, axis] = k * GRID_M
                    lines.append(line)
        name = f"{parent}/grid {every}"
        scene.add_line_segments(name, np.array(lines), GRID, thickness=width, thickness_units="screen")
    ends = np.array(AXES_AT_M) + np.stack([np.zeros((3, 3)), AXIS_LENGTH_M * np.eye(3)], axis=1)
    shape: Any = {"shaft_radius": 0.004, "head_radius": 0.01, "head_length": 0.03}
    scene.add_arrows(f"{parent}/axes", ends, np.array(AXES, np.uint8), **shape)
    for name, (_, end) in zip(AXIS_NAMES, ends, strict=True):
        scene.add_label(f"{parent}/axes/{name[0]}", name, position=end, font_screen_scale=0.8, anchor="bottom-left")
