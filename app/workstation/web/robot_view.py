"""RobotView: the robot in the browser, whose links are sent once and then only moved; and arrows to guide it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation
from viser import SceneApi

from layflat.app.media import cloth_colors as colors
from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.data.arrays import FloatArray
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.robots.arm_shape import ArmShape
from layflat.sim.robots.registry import robot_type

OnGuide: TypeAlias = Callable[[int, FloatArray | None], None]
"""Called with the number of a viewer and the place of the guiding hand as in `TeleopInput.hand`, or None at its end."""
PICKER_M = 0.011
"""Radius of a picker."""
ARROWS_M = 0.13
"""Length of the guiding arrows."""


class RobotView:
    """The arm's links, each a mesh that is sent once and then only moved; or two balls for pickers."""

    def __init__(self, scene: SceneApi, parent: str, frame: SimulationFrame, cloth: ClothSpec) -> None:
        self._scene = scene
        self._parent = parent
        self._type = robot_type(frame.robot)
        self.root = scene.add_frame(f"{parent}/robot", show_axes=False)
        self._shape = shape = self._type.arm_shape(cloth)
        self._links = [] if shape is None else _add_links(scene, f"{parent}/robot", shape)
        self._balls = [
            scene.add_icosphere(f"{parent}/robot/picker {k + 1}", PICKER_M, colors.HOLDER, cast_shadow=False)
            for k in range(0 if shape is not None else len(frame.corners))
        ]
        self._gizmos: list[Any] = []
        self._held: int | None = None
        self._frame = frame

    def show(self, frame: SimulationFrame) -> None:
        """Move links, pickers and, unless somebody holds it, the guiding arrows."""
        self._frame = frame
        if self._shape is not None and len(frame.joints):
            frames = self._shape.link_frames(frame.joints)
            turns = Rotation.from_matrix(frames[:, :3, :3]).as_quat(scalar_first=True)
            for link, handle in self._links:
                handle.position, handle.wxyz = frames[link, :3, 3], turns[link]
        for ball, at in zip(self._balls, frame.corners, strict=False):
            ball.position = at
        for k, (gizmo, at) in enumerate(zip(self._gizmos, self._points(), strict=False)):
            if self._held != k:
                gizmo.position = at

    def _points(self) -> FloatArray:
        frame = self._frame
        return frame.holder[None] if self._type.spec.n_points == 1 else frame.corners

    def let_guide(self, on_guide: OnGuide | None) -> None:
        """Add arrows along the axes that each point of the robot can move."""
        for gizmo in self._gizmos:
            gizmo.remove()
        self._gizmos = []
        if on_guide is None:
            return
        for k, at in enumerate(self._points()):
            free = tuple(any(a.point == k and a.axis == axis for a in self._type.spec.axes) for axis in range(3))
            gizmo = self._scene.add_transform_controls(
                f"{self._parent}/robot/guide {k + 1}", ARROWS_M, active_axes=(free[0], free[1], free[2]),
                disable_rotations=True, depth_test=False, position=at,
            )  # fmt: skip
            gizmo.on_update(self._guided(k, gizmo, on_guide))
            self._gizmos.append(gizmo)

    def _guided(self, k: int, gizmo: Any, on_guide: OnGuide) -> Any:
        async def guided(event: Any) -> None:
            if event.client_id is None:
                return
            self._held = None if event.phase == "end" else k
            places = self._points().copy()
            places[k] = gizmo.position
            on_guide(event.client_id, None if self._held is None else places.reshape(self._type.spec.hand_shape))

        return guided


def _add_links(scene: SceneApi, parent: str, shape: ArmShape) -> list[tuple[int, Any]]:
    """Add a mesh for each link and for the hanger; return them with the number of their link."""
    handles = []
    of_triangle = shape.link[shape.triangles[:, 0]]
    for link in np.unique(of_triangle):
        for hanger, rgb in ((False, colors.ARM), (True, colors.HOLDER)):
            own = shape.triangles[(of_triangle == link) & (shape.is_hanger == hanger)]
            if len(own):
                used, faces = np.unique(own, return_inverse=True)
                name = f"{parent}/{'hanger' if hanger else 'link'} {link}"
                options: dict[str, Any] = {"color": rgb, "flat_shading": True, "cast_shadow": False}
                handle = scene.add_mesh_simple(name, shape.vertices[used], faces.reshape(-1, 3), **options)
                handles.append((int(link), handle))
    return handles
