"""Marks: hands, force, rubber band and the place to cover, over the cloth in the browser."""

from __future__ import annotations

from typing import Any

import numpy as np
from viser import SceneApi

from layflat.app.media import cloth_colors as colors
from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.data.arrays import FloatArray
from layflat.data.types import DragTarget

FORCE_M_PER_N = 0.06
"""Length of a force's arrow."""
LEAST_FORCE_N = 0.02


class Marks:
    """Hands, force, rubber band and target of one scene."""

    def __init__(self, scene: SceneApi, parent: str) -> None:
        self._hands = scene.add_point_cloud(
            f"{parent}/hands", np.zeros((0, 3)), colors.HAND, point_size=0.018, point_shape="circle"
        )
        line: dict[str, Any] = {"thickness_units": "screen"}
        empty = np.zeros((0, 2, 3))
        self._band = scene.add_line_segments(f"{parent}/band", empty, colors.HAND, thickness=4.0, **line)
        self._target = scene.add_line_segments(f"{parent}/target", empty, colors.TARGET, thickness=3.0, **line)
        self._force = scene.add_arrows(
            f"{parent}/force", empty, colors.HAND, shaft_radius=0.004, head_radius=0.011, head_length=0.025
        )

    def show(self, frame: SimulationFrame, drag: DragTarget | None) -> None:
        """Show what acts on the cloth."""
        points = frame.hands
        if drag is None:
            self._band.points = np.zeros((0, 2, 3), np.float32)
        else:
            points = self.show_pull(frame.nodes[drag.node], np.array(drag.target_m))
        self._hands.points = points.astype(np.float32)
        force = np.linalg.norm(frame.force_n) > LEAST_FORCE_N
        start = frame.hands.mean(axis=0) if len(frame.hands) else frame.nodes.mean(axis=0)
        ends = [[start, start + FORCE_M_PER_N * frame.force_n]] if force and drag is None else np.zeros((0, 2, 3))
        self._force.points = np.array(ends, np.float32)

    def show_pull(self, node_m: FloatArray, target_m: FloatArray) -> FloatArray:
        """Draw a rubber band; return its ends, (2, 3) m."""
        ends = np.array([node_m, target_m])
        self._band.points = ends[None].astype(np.float32)
        return ends

    def show_target(self, corners: FloatArray | None) -> None:
        """Outline a place on the table, (4, 3) m."""
        sides = np.zeros((0, 2, 3)) if corners is None else np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
        self._target.points = sides.astype(np.float32)
