"""Scene: cloth and robot in 3D in the browser, with what a person pulls at and what a person aims at."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from viser import SceneApi

from layflat.app.media import cloth_colors as colors
from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.web.stage import LINE_M, SHADOW_M, Point, add_table
from layflat.data.arrays import FloatArray
from layflat.data.types import DragTarget
from layflat.sim.cloth.mesh import MeshMaker
from layflat.sim.cloth.spec import ClothSpec, cloth_spec
from layflat.sim.robots.arm_shape import ArmShape
from layflat.sim.robots.registry import robot_type

OnDrag: TypeAlias = Callable[[int, DragTarget | None], None]
"""Called with the number of a viewer and where the cloth is pulled to, or None when it lets go."""
OnGuide: TypeAlias = Callable[[int, FloatArray | None], None]
"""Called with the number of a viewer and the place of the guiding hand as in `TeleopInput.hand`, or None at its end."""

SUBDIVISIONS = 2
LIFT_M = 0.0015
"""Height of fold lines above the cloth."""
FORCE_M_PER_N = 0.06
LEAST_FORCE_N = 0.02
LOWEST_TARGET_M = 0.004
"""Lowest height of a drag's target: where cloth rests."""
HUNG_M = 0.05
"""A cloth whose free edge is higher at the start of an episode hangs, and has a place to be laid."""


class Scene:
    """Table, cloth, robot and marks below one node; several can stand side by side."""

    def __init__(self, scene: SceneApi, *, name: str = "/bench", offset_m: Point = (0.0, 0.0, 0.0)) -> None:
        self._scene = scene
        self._name = name
        self._offset = np.array(offset_m)
        self._root = scene.add_frame(name, show_axes=False, position=offset_m)
        add_table(scene, name)
        self._marks = Marks(scene, name)
        self._cloth: _Cloth | None = None
        self._robot: _Robot | None = None
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
            if frame.episode != self._episode:
                self._episode, self._pulled = frame.episode, None
                self._marks.show_target(landing(self._cloth.spec, frame.nodes))
            self._frame = frame
            self._cloth.show(frame.nodes)
            self._robot.show(frame)
            self._marks.show(frame, self._pulled[1] if self._pulled else frame.drag)

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
                part.remove()
        spec = cloth_spec(frame.cloth)
        self._shown, self._episode = (frame.robot, frame.cloth), None
        self._cloth = _Cloth(self._scene, self._name, spec, frame.nodes)
        self._robot = _Robot(self._scene, self._name, frame, spec)
        self.let_drag(self._on_drag)
        self.let_guide(self._on_guide)

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
        self._marks.show_pull(frame.nodes[node], target)
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
    return np.array([[x + dx, y + dy, LINE_M] for dx, dy in
                     ((0, -half), (spec.length_m, -half), (spec.length_m, half), (0, half))])  # fmt: skip


class _Cloth:
    """The cloth's meshes: each color is one, with its own vertices."""

    def __init__(self, scene: SceneApi, parent: str, spec: ClothSpec, nodes: FloatArray) -> None:
        self.spec = spec
        self._maker = MeshMaker(spec, subdivisions=SUBDIVISIONS)
        self._paint = colors.ClothPaint(spec, subdivisions=SUBDIVISIONS)
        self._coarse = np.array(spec.triangles())
        self._contact = colors.ClothPaint(spec, subdivisions=1)
        mesh = self._maker.mesh(nodes)
        self._root = scene.add_frame(f"{parent}/cloth", show_axes=False)
        self._parts: list[tuple[Any, NDArray[np.intp]]] = []
        everything = np.ones(len(self._paint.triangles), dtype=bool)
        for name, kept, rgb, side in (
            ("face", ~self._paint.checked, colors.FACE, "front"),
            ("check", self._paint.checked, colors.FACE_CHECK, "front"),
            ("reverse", everything, colors.REVERSE, "back"),
        ):
            used, faces = np.unique(self._paint.triangles[kept], return_inverse=True)
            options: dict[str, Any] = {"color": rgb, "side": side, "cast_shadow": False, "receive_shadow": False}
            handle = scene.add_mesh_simple(
                f"{parent}/cloth/{name}", mesh.vertices[used], faces.reshape(-1, 3), **options
            )
            self._parts.append((handle, used))
        flat: dict[str, Any] = {"side": "double", "cast_shadow": False, "receive_shadow": False}
        none = self._coarse[:0]
        self._rests = scene.add_mesh_simple(f"{parent}/cloth/contact", nodes, none, color=colors.CONTACT_SHADE,
                                            opacity=colors.CONTACT_SHARE, **flat)  # fmt: skip
        self._shadow = scene.add_mesh_simple(f"{parent}/cloth/shadow", nodes, self._coarse, color=(26, 30, 37), **flat)
        self._ghost = scene.add_mesh_simple(f"{parent}/cloth/ghost", nodes, self._coarse, color=colors.GHOST,
                                            opacity=0.28, visible=False, **flat)  # fmt: skip
        self._folds = [
            scene.add_line_segments(f"{parent}/cloth/{name}", np.zeros((0, 2, 3)), rgb, thickness=wide,
                                    thickness_units="screen")
            for name, rgb, wide in (("fold rim", colors.FOLD_RIM, 7.0), ("fold", colors.FOLD, 3.5))
        ]  # fmt: skip

    def show(self, nodes: FloatArray) -> None:
        """Move the cloth, its shadow straight below it, what is shaded, and the lines of its folds."""
        mesh = self._maker.mesh(nodes)
        for handle, used in self._parts:
            handle.vertices = mesh.vertices[used]
        rests = self._contact.resting(nodes)
        if rests.any():
            self._rests.vertices = _raised(nodes, LIFT_M)
        self._rests.faces = self._coarse[rests]
        self._shadow.vertices = _raised(nodes * [1.0, 1.0, 0.0], SHADOW_M)
        lines = self._paint.fold_lines(mesh)
        for k, handle in enumerate(self._folds):
            handle.points = _raised(lines, (k + 1) * LIFT_M)

    def show_ghost(self, nodes: FloatArray | None) -> None:
        self._ghost.visible = nodes is not None and len(nodes) == self.spec.n_nodes
        if nodes is not None and self._ghost.visible:
            self._ghost.vertices = nodes.astype(np.float32)

    def let_drag(self, callback: Callable[[Any], Any] | None) -> None:
        for handle, _ in self._parts:
            handle.remove_drag_callback()
            if callback is not None:
                handle.on_drag("left")(callback)

    def remove(self) -> None:
        self._root.remove()


def _raised(points: FloatArray, by_m: float) -> NDArray[np.float32]:
    return (points + np.array([0.0, 0.0, by_m])).astype(np.float32)


class _Robot:
    """The arm's links, each a mesh that is sent once and then only moved; or two balls for pickers."""

    def __init__(self, scene: SceneApi, parent: str, frame: SimulationFrame, cloth: ClothSpec) -> None:
        self._scene = scene
        self._parent = parent
        self._type = robot_type(frame.robot)
        self._root = scene.add_frame(f"{parent}/robot", show_axes=False)
        shape = self._type.arm_shape(cloth)
        self._shape: ArmShape | None = shape
        self._links = [] if shape is None else _add_links(scene, f"{parent}/robot", shape)
        self._balls = [
            scene.add_icosphere(f"{parent}/robot/picker {k + 1}", 0.011, colors.HOLDER, cast_shadow=False)
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
                f"{self._parent}/robot/guide {k + 1}",
                0.13,
                active_axes=(free[0], free[1], free[2]),
                disable_rotations=True,
                depth_test=False,
                position=at,
            )
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

    def remove(self) -> None:
        self._root.remove()


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


class Marks:
    """What is shown over the cloth: hands, force, rubber band, and where it is to be laid."""

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
