"""The bench in the window: 3D view and camera picture, drawn again when something has changed, and the mouse there."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
import pygame
from numpy.typing import NDArray

from layflat.app.workstation.session.frame_channel import BenchFrame
from layflat.app.workstation.window import style
from layflat.app.workstation.window.orbit_camera import OrbitCamera
from layflat.app.workstation.window.view3d import Scene, View3d
from layflat.data.arrays import FloatArray
from layflat.data.types import DragTarget
from layflat.perception.overlay import draw_cloth_state
from layflat.sim.camera.camera import default_pinhole
from layflat.sim.cloth.spec import cloth_spec
from layflat.sim.disturbances.mouse_drag import pick_node
from layflat.sim.robots.registry import robot_type

_PINHOLE = default_pinhole()
TABLE_LIFT_M = 0.004
"""What is pulled is never pulled below where cloth rests."""
MIDDLE = 2
"""The mouse's button that shifts the view; with Shift the others do, too."""


@dataclass
class Viewport:
    """Draws moments, and turns what the mouse does into a view or a pull."""

    orbit: OrbitCamera = field(default_factory=OrbitCamera)
    hover: int | None = None
    """The node that a click would take hold of."""
    pull: DragTarget | None = None
    """What the mouse pulls at."""
    lead: FloatArray | None = None
    """Where the hand is that leads the holder, as in Reading.hand."""
    dragging: str = ""
    """turn, pan, or pull, while a button is down in the view."""
    _view: tuple[tuple[str, str], View3d] | None = None
    _drawn: tuple[Any, pygame.Surface] | None = None
    _seen: tuple[Any, pygame.Surface] | None = None

    def paint(self, surface: pygame.Surface, moment: BenchFrame) -> None:
        """The 3D view fills ``surface``."""
        key = (id(moment), self.orbit, surface.get_size(), self.hover, id(self.pull), id(self.lead))
        if self._drawn is None or self._drawn[0] != key:
            picture = self._picture(moment, surface.get_size())
            self._drawn = (key, style.picture(picture))
        surface.blit(self._drawn[1], (0, 0))

    def _picture(self, moment: BenchFrame, size: tuple[int, int]) -> NDArray[np.uint8]:
        kind = (moment.robot, moment.cloth)
        if self._view is None or self._view[0] != kind:
            spec = cloth_spec(moment.cloth)
            arm = robot_type(moment.robot).arm_shape(spec)
            self._view = (kind, View3d(spec, arm))
        return self._view[1].draw(self._scene(moment), self.orbit, size)

    def _scene(self, moment: BenchFrame) -> Scene:
        pull = self.pull or (None if moment.pull is None else DragTarget(node=moment.pull[0], target_m=moment.pull[1]))
        arm = len(moment.joints) > 0
        return Scene(
            nodes=moment.nodes,
            corners=np.zeros((0, 3)) if arm else moment.corners,
            joints=moment.joints if arm else None,
            hands=moment.hands,
            force_n=moment.force_n,
            pull=None if pull is None else (moment.nodes[pull.node], np.array(pull.target_m)),
            leads=_leads(moment, self.lead),
            hover=None if self.hover is None else moment.nodes[self.hover],
        )

    def paint_camera(self, surface: pygame.Surface, moment: BenchFrame | None) -> None:
        """What the bench's camera sees, with contact and WORD drawn on it."""
        area = surface.get_rect()
        surface.fill(style.GROUND)
        if moment is None or moment.rgb is None or moment.cloth_state is None:
            style.card(surface, area)
            style.write(surface, "Camera", (12, 7), 13, style.QUIET)
            return
        key = (id(moment), area.size)
        if self._seen is None or self._seen[0] != key:
            # On a small card the overlay at the camera's own size reads better, and is drawn in a third of the time.
            scale = 1 if area.width < 1.5 * _PINHOLE.width else 2
            drawn = draw_cloth_state(moment.rgb, moment.cloth_state, _PINHOLE, scale=scale)
            how = cv2.INTER_AREA if drawn.shape[1] > area.width else cv2.INTER_CUBIC
            small = np.asarray(cv2.resize(drawn, area.size, interpolation=how), dtype=np.uint8)
            self._seen = (key, style.picture(small))
        surface.blit(self._seen[1], (0, 0))
        _round_corners(surface)

    # The mouse, in pixels of the view

    def press(
        self, at: tuple[int, int], button: int, size: tuple[int, int], moment: BenchFrame | None, pull: bool
    ) -> None:
        """A button goes down at ``at``; ``pull``: the cloth may be pulled at now."""
        node = self._node(at, size, moment) if pull and button == 1 and moment is not None else None
        if node is not None and moment is not None:
            self.dragging = "pull"
            self.pull = DragTarget(node=node, target_m=moment.nodes[node])
        else:
            shifted = bool(pygame.key.get_mods() & pygame.KMOD_SHIFT)
            self.dragging = "pan" if button == MIDDLE or shifted else "turn"

    def move(self, at: tuple[int, int], by: tuple[int, int], size: tuple[int, int], moment: BenchFrame | None) -> None:
        """The mouse moves: the view turns or shifts, or what is held follows in the plane that faces the eye."""
        if self.dragging == "turn":
            self.orbit = self.orbit.turned(*by)
        elif self.dragging == "pan":
            self.orbit = self.orbit.panned(*by, size[1])
        elif self.dragging == "pull" and self.pull is not None:
            target = self.orbit.dragged(np.array(self.pull.target_m), *by, size[1])
            target[2] = max(target[2], TABLE_LIFT_M)
            self.pull = replace(self.pull, target_m=target)

    def point(self, at: tuple[int, int], size: tuple[int, int], moment: BenchFrame | None, pull: bool) -> None:
        """The mouse is at ``at`` with no button down."""
        self.hover = self._node(at, size, moment) if pull and moment is not None else None

    def release(self) -> None:
        self.dragging, self.pull = "", None

    def release_pull(self) -> None:
        """Let go of the cloth, if it is held; a view that is being turned stays in hand."""
        if self.dragging == "pull":
            self.release()

    def zoom(self, steps: float) -> None:
        self.orbit = self.orbit.zoomed(steps)

    def _node(self, at: tuple[int, int], size: tuple[int, int], moment: BenchFrame | None) -> int | None:
        if moment is None:
            return None
        origin, direction = self.orbit.ray(at, size)
        return pick_node(moment.nodes, cloth_spec(moment.cloth).triangles(), origin, direction)

    def pixel_of(self, point: FloatArray, size: tuple[int, int]) -> tuple[int, int]:
        """Where a point (3,) m is seen in a view of ``size``."""
        x, y = self.orbit.project(point, size)[0][0]
        return round(float(x)), round(float(y))


def _leads(moment: BenchFrame, hand: FloatArray | None) -> tuple[tuple[FloatArray, FloatArray], ...]:
    """The hanger and its hand, or the picker that is led: the other hand is where its picker is."""
    if hand is None:
        return ()
    if hand.ndim == 1:
        return ((moment.holder, hand),)
    led = int(np.linalg.norm(hand - moment.corners, axis=1).argmax())
    return ((moment.corners[led], hand[led]),)


def _round_corners(surface: pygame.Surface) -> None:
    """Pictures end as cards do."""
    width, height = surface.get_size()
    radius = style.RADIUS
    for x, y in ((0, 0), (width - radius, 0), (0, height - radius), (width - radius, height - radius)):
        centre = (radius if x == 0 else width - radius - 1, radius if y == 0 else height - radius - 1)
        corner = pygame.Surface((radius, radius), pygame.SRCALPHA)
        corner.fill(style.GROUND)
        pygame.draw.circle(corner, (0, 0, 0, 0), (centre[0] - x, centre[1] - y), radius)
        surface.blit(corner, (x, y))
