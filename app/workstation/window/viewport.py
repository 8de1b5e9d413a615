"""Viewport: the 3D view and the camera's image, redrawn when something has changed, and the mouse in the view."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import cv2
import numpy as np
import pygame

from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.window import style
from layflat.app.workstation.window.orbit_camera import OrbitCamera
from layflat.app.workstation.window.style import Canvas
from layflat.app.workstation.window.view3d import Scene, View3d, axis_heads
from layflat.data.arrays import FloatArray
from layflat.data.types import DragTarget
from layflat.perception.overlay import draw_cloth_state
from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.disturbances.mouse_drag import pick_node
from layflat.sim.robots.registry import robot_type

TABLE_LIFT_M = 0.004
"""Lowest height of a drag's target: where cloth rests."""
MIDDLE = 2
"""Mouse button that pans the view; with Shift the others do, too."""


@dataclass
class Viewport:
    """Draws frames, and turns the mouse into camera motion or a drag of the cloth."""

    camera: OrbitCamera = field(default_factory=OrbitCamera)
    hover: int | None = None
    """Node that a click would grab."""
    drag: DragTarget | None = None
    """Node that the mouse drags, and where to."""
    hand: FloatArray | None = None
    """Place of the hand that guides the robot, as in TeleopInput.hand."""
    dragging: Literal["", "turn", "pan", "cloth"] = ""
    """The use of a button that is down in the view."""
    _view: tuple[tuple[str, str], View3d] | None = None

    def draw(self, canvas: Canvas, frame: SimulationFrame, ghost: FloatArray | None = None) -> None:
        """Fill the canvas with the 3D view; ``ghost``: nodes (N, 3) of a demonstration beside the cloth."""
        size = canvas.surface.get_size()
        rgb = self._view3d(frame).draw(self._scene(frame, ghost), self.camera, size, canvas.scale)
        canvas.surface.blit(style.make_picture(rgb), (0, 0))
        for name, color, head in axis_heads():
            canvas.text(name, self.pixel_of(head, size), 12, color, align="center")

    def _view3d(self, frame: SimulationFrame) -> View3d:
        key = (frame.robot, frame.cloth)
        if self._view is None or self._view[0] != key:
            spec = cloth_spec(frame.cloth)
            self._view = (key, View3d(spec, robot_type(frame.robot).arm_shape(spec)))
        return self._view[1]

    def _scene(self, frame: SimulationFrame, ghost: FloatArray | None) -> Scene:
        drag = self.drag or frame.drag
        has_arm = len(frame.joints) > 0
        return Scene(
            nodes=frame.nodes,
            corners=frame.corners,
            joints=frame.joints if has_arm else None,
            hands=frame.hands,
            force_n=frame.force_n,
            drag=None if drag is None else (frame.nodes[drag.node], np.array(drag.target_m)),
            guided=_guided(frame, self.hand),
            hover=None if self.hover is None else frame.nodes[self.hover],
            ghost=ghost,
        )

    def draw_camera(self, canvas: Canvas, frame: SimulationFrame | None) -> None:
        """Fill the canvas with the camera's image, with contact and WORD drawn on it."""
        surface, area = canvas.surface, canvas.area
        surface.fill(style.BACKGROUND)
        if frame is None or frame.rgb is None or frame.cloth_state is None:
            canvas.card()
            canvas.text("Camera", (canvas.px(12), canvas.px(7)), 13, style.QUIET)
            return
        # On a small card the overlay at the camera's own size reads better, and is drawn in a third of the time.
        scale = 1 if area.width < 1.5 * frame.pinhole.width else 2
        drawn = draw_cloth_state(frame.rgb, frame.cloth_state, frame.pinhole, scale=scale)
        factor = min(area.width / drawn.shape[1], area.height / drawn.shape[0])
        size = (round(drawn.shape[1] * factor), round(drawn.shape[0] * factor))
        small = cv2.resize(drawn, size, interpolation=cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC)
        picture = style.make_picture(np.asarray(small, dtype=np.uint8))
        surface.blit(picture, picture.get_rect(center=area.center))

    def handle_mouse(
        self, event: pygame.event.Event, view: pygame.Rect, scale: float, frame: SimulationFrame | None, drag: bool
    ) -> None:
        """Handle the mouse in the window, whose part ``view`` this is; ``drag``: the cloth may be dragged now."""
        if event.type == pygame.MOUSEBUTTONUP:
            self.dragging, self.drag = "", None
        elif event.type == pygame.MOUSEMOTION and self.dragging:
            self._move(event.rel, view.height, scale)
        elif event.type in (pygame.MOUSEBUTTONDOWN, pygame.MOUSEMOTION, pygame.MOUSEWHEEL):
            pos = pygame.mouse.get_pos() if event.type == pygame.MOUSEWHEEL else event.pos
            node = self._node((pos[0] - view.left, pos[1] - view.top), view.size, frame) if drag else None
            if not view.collidepoint(pos):
                return
            if event.type == pygame.MOUSEWHEEL:
                self.camera = self.camera.zoomed(getattr(event, "precise_y", event.y))
            elif event.type == pygame.MOUSEMOTION:
                self.hover = node
            elif node is not None and frame is not None and event.button == 1:
                self.dragging, self.drag = "cloth", DragTarget(node=node, target_m=frame.nodes[node])
            elif event.button in (1, 2, 3):
                shifted = bool(pygame.key.get_mods() & pygame.KMOD_SHIFT)
                self.dragging = "pan" if event.button == MIDDLE or shifted else "turn"

    def _move(self, by: tuple[int, int], height: int, scale: float) -> None:
        """Turn or pan the view, or drag the cloth in the plane that faces the eye."""
        if self.dragging == "turn":
            self.camera = self.camera.turned(by[0] / scale, by[1] / scale)
        elif self.dragging == "pan":
            self.camera = self.camera.panned(*by, height)
        elif self.drag is not None:
            target = self.camera.dragged(np.array(self.drag.target_m), *by, height)
            target[2] = max(target[2], TABLE_LIFT_M)
            self.drag = replace(self.drag, target_m=target)

    def end_drag(self) -> None:
        """Release the cloth, if it is dragged; a view that is being turned is left alone."""
        if self.dragging == "cloth":
            self.dragging, self.drag = "", None

    def _node(self, at: tuple[int, int], size: tuple[int, int], frame: SimulationFrame | None) -> int | None:
        if frame is None:
            return None
        origin, direction = self.camera.ray(at, size)
        return pick_node(frame.nodes, cloth_spec(frame.cloth).triangles(), origin, direction)

    def pixel_of(self, point: FloatArray, size: tuple[int, int]) -> tuple[int, int]:
        """Return where a point (3,) m is seen in a view of ``size``."""
        x, y = self.camera.project(point, size)[0][0]
        return round(float(x)), round(float(y))


def _guided(frame: SimulationFrame, hand: FloatArray | None) -> tuple[FloatArray, FloatArray] | None:
    """Return the place that is guided and its hand; of two hands, the one that is not where its corner is."""
    if hand is None:
        return None
    if hand.ndim == 1:
        return frame.holder, hand
    point = int(np.linalg.norm(hand - frame.corners, axis=1).argmax())
    return frame.corners[point], hand[point]
