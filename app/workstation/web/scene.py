"""Scene: cloth, robot, what acts on the cloth and what a person aims at, in 3D in the browser."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from viser import SceneApi

from layflat.app.media import cloth_colors as colors
from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.web.cloth_view import ClothView
from layflat.app.workstation.web.robot_view import OnGuide, RobotView
from layflat.app.workstation.web.stage import LINE_M, Point, add_table
from layflat.data.arrays import FloatArray
from layflat.data.types import DragTarget
from layflat.sim.cloth.spec import ClothSpec

OnDrag: TypeAlias = Callable[[int, DragTarget | None], None]
"""Called with the number of a viewer and where the cloth is pulled to, or None when it lets go."""
FORCE_M_PER_N = 0.06
"""Length of a force's arrow."""
LEAST_FORCE_N = 0.02
LOWEST_TARGET_M = 0.004
"""Lowest height of a drag's target: where cloth rests."""
HUNG_M = 0.05
"""A cloth whose free edge is higher at the start of an episode hangs, and has a place to be laid."""
NO_LINES = np.zeros((0, 2, 3), np.float32)


class Scene:
    """Table, cloth, robot and marks below one node; several can stand side by side."""

    def __init__(self, scene: SceneApi, *, name: str = "/bench", offset_m: Point = (0.0, 0.0, 0.0)) -> None:
        self._scene = scene
        self._name = name
        self._offset = np.array(offset_m)
        self._root = scene.add_frame(name, show_axes=False, position=offset_m)
        add_table(scene, name)
        dots: dict[str, Any] = {"point_size": 0.018, "point_shape": "circle"}
        self._hands = scene.add_point_cloud(f"{name}/hands", np.zeros((0, 3)), colors.HAND, **dots)
        self._band, self._target = (
            scene.add_line_segments(f"{name}/{part}", NO_LINES, rgb, thickness=wide, thickness_units="screen")
            for part, rgb, wide in (("band", colors.HAND, 4.0), ("target", colors.TARGET, 3.0))
        )
        arrow: Any = {"shaft_radius": 0.004, "head_radius": 0.011, "head_length": 0.025}
        self._force = scene.add_arrows(f"{name}/force", NO_LINES, colors.HAND, **arrow)
        self._cloth: ClothView | None = None
        self._robot: RobotView | None = None
        self._shown: tuple[str, str] | None = None
        self._episode: int | None = None
        self._frame: SimulationFrame | None = None
        self._on_drag: OnDrag | None = None
        self._on_guide: OnGuide | None = None
        self._pulled: tuple[int, DragTarget] | None = None

    def show(self, frame: SimulationFrame) -> None:
        """Show a frame; only what differs from the last one is sent."""
        if not len(frame.nodes) or not np.isfinite(frame.nodes).all():
            return
        with self._scene._websock_interface.atomic():
            if self._shown != (frame.robot, frame.cloth):
                self._build(frame)
            if self._cloth is None or self._robot is None:
                return
            if frame.episode != self._episode or not frame.step:
                self._episode, self._pulled = frame.episode, None
                corners = landing(self._cloth.painter.spec, frame.nodes)
                sides = NO_LINES if corners is None else np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
                self._target.points = sides.astype(np.float32)
            self._frame = frame
            self._cloth.show(frame)
            self._robot.show(frame)
            self._show_forces(frame, self._pulled[1] if self._pulled else frame.drag)

    def show_ghost(self, nodes: FloatArray | None) -> None:
        """Show a second, translucent cloth with these nodes (N, 3) m: a good demonstration; None hides it."""
        if self._cloth is not None:
            self._cloth.show_ghost(nodes)

    def let_drag(self, on_drag: OnDrag | None) -> None:
        """Let viewers pull at the cloth with the left button, or no longer (None)."""
        self._on_drag, self._pulled = on_drag, None
        if self._cloth is not None:
            self._cloth.let_drag(None if on_drag is None else self._dragged)

    def let_guide(self, on_guide: OnGuide | None) -> None:
        """Put arrows at the robot with which viewers guide it by hand, or take them away (None)."""
        self._on_guide = on_guide
        if self._robot is not None:
            self._robot.let_guide(on_guide)

    def remove(self) -> None:
        """Take everything away."""
        self._root.remove()

    def _build(self, frame: SimulationFrame) -> None:
        """Put another cloth and robot on the table."""
        for part in (self._cloth, self._robot):
            if part is not None:
                part.root.remove()
        self._shown, self._episode = (frame.robot, frame.cloth), None
        self._cloth = ClothView(self._scene, self._name, frame)
        self._robot = RobotView(self._scene, self._name, frame, self._cloth.painter.spec)
        self.let_drag(self._on_drag)
        self.let_guide(self._on_guide)

    def _show_forces(self, frame: SimulationFrame, drag: DragTarget | None) -> None:
        band: Any = NO_LINES
        arrows, points = band, frame.hands
        if drag is not None:
            points = np.array([frame.nodes[drag.node], drag.target_m])
            band = points[None]
        elif np.linalg.norm(frame.force_n) > LEAST_FORCE_N:
            start = frame.hands.mean(axis=0) if len(frame.hands) else frame.nodes.mean(axis=0)
            arrows = np.array([[start, start + FORCE_M_PER_N * frame.force_n]])
        self._band.points, self._force.points = band.astype(np.float32), arrows.astype(np.float32)
        self._hands.points = points.astype(np.float32)

    async def _dragged(self, event: Any) -> None:
        """Turn a drag of the mesh into a pull at the node that is nearest to where it began.

        A coroutine, since viser calls only these in the order of the events.
        """
        frame = self._frame
        if frame is None or self._on_drag is None:
            return
        if event.phase == "start":
            at = np.array(event.start_position) - self._offset
            node = int(np.linalg.norm(frame.nodes - at, axis=1).argmin())
        elif self._pulled is not None and self._pulled[0] == event.client_id:
            node = self._pulled[1].node
        else:
            return
        if event.phase == "end":
            self._pulled = None
            self._on_drag(event.client_id, None)
            return
        target = np.array(event.end_position) - self._offset
        target[2] = max(target[2], LOWEST_TARGET_M)
        drag = DragTarget(node=node, target_m=target)
        self._pulled = (event.client_id, drag)
        self._band.points = np.array([[frame.nodes[node], target]], np.float32)
        self._on_drag(event.client_id, drag)


def landing(spec: ClothSpec, nodes: FloatArray) -> FloatArray | None:
    """Return the corners (4, 3) m of the place that a hanging cloth is to cover, from below its free edge forward.

    None where the cloth does not hang.
    """
    edge = nodes[: spec.columns]
    if edge[:, 2].min() < HUNG_M:
        return None
    x, y = edge[:, :2].mean(axis=0)
    half = spec.width_m / 2
    corners = ((0, -half), (spec.length_m, -half), (spec.length_m, half), (0, half))
    return np.array([[x + dx, y + dy, LINE_M] for dx, dy in corners])
