"""Guide: the hands in the scene, which pull at the cloth and guide the robot."""

from __future__ import annotations

from typing import Any

import numpy as np
import viser

from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.web.scene import Scene
from layflat.app.workstation.web.workstation import Workstation
from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec
from layflat.data.types import DragTarget

ARROWS_M = 0.12
"""Length of the arrows at the robot."""


class Guide:
    """Arrows at each point of the robot, and drags of the cloth, of one viewer."""

    def __init__(self, workstation: Workstation, client: viser.ClientHandle, scene: Scene, name: str) -> None:
        self._workstation = workstation
        self._client = client
        self._scene = scene
        self._name = name
        """Name of the viewer."""
        self._arrows: list[Any] = []
        self._robot = ""
        self._cloth: Any = None
        self._held: int | None = None
        """Point that is held."""
        self._node: int | None = None
        """Node of the cloth that is pulled."""

    def update(self, frame: SimulationFrame | None) -> None:
        """Follow the robot with the arrows that are not held, and listen to the cloth that is shown."""
        session = self._workstation.session
        if self._scene.cloth is not self._cloth:
            self._cloth = self._scene.cloth
            self._cloth.on_drag("left")(self._on_drag)
        live = frame is not None and frame is session.frame and session.robot is not None
        by_hand = live and session.status.source == "kinesthetic" and session.status.state in ("still", "running")
        if not (by_hand and self._workstation.in_control(self._name)) or frame is None or session.robot is None:
            for arrows in self._arrows:
                if arrows.visible:
                    arrows.visible = False
            return
        if self._robot != session.robot.name:
            self._make(session.robot)
        for point, at in enumerate(points(session.robot, frame)):
            arrows = self._arrows[point]
            if not arrows.visible:
                arrows.visible = True
            if self._held != point:
                arrows.position = at

    def _make(self, robot: RobotSpec) -> None:
        for arrows in self._arrows:
            arrows.remove()
        self._robot, self._arrows = robot.name, []
        for point in range(robot.n_points):
            x, y, z = (any(a.point == point and a.axis == axis for a in robot.axes) for axis in range(3))
            arrows = self._client.scene.add_transform_controls(
                f"/guide/{point}", scale=ARROWS_M, active_axes=(x, y, z), disable_rotations=True, depth_test=False
            )
            arrows.on_update(self._follow(point))
            self._arrows.append(arrows)

    def _follow(self, point: int) -> Any:
        async def on_update(event: Any) -> None:
            at = np.array(event.target.position, dtype=float)
            phase = event.phase
            self._workstation.post(lambda: self._guide(point, at, phase), self._client.client_id)

        return on_update

    def _guide(self, point: int, at: FloatArray, phase: str) -> None:
        """Draw the robot's point to where its arrows are."""
        workstation = self._workstation
        robot, frame = workstation.session.robot, workstation.session.frame
        if phase == "end" or robot is None or frame is None:
            self._held = workstation.inputs.hand = None
            return
        self._workstation.require_control(self._name)
        self._held = point
        places = points(robot, frame) if workstation.inputs.hand is None else workstation.inputs.hand
        places = places.reshape(-1, 3).copy()
        places[point] = at
        workstation.inputs.hand = places.reshape(robot.hand_shape)

    async def _on_drag(self, event: Any) -> None:
        start, end, phase = event.start_position, event.end_position, event.phase
        self._workstation.post(lambda: self._pull(start, end, phase), self._client.client_id)

    def _pull(self, start: tuple[float, ...], end: tuple[float, ...], phase: str) -> None:
        """Pull the node that was under the pointer when the drag started."""
        workstation = self._workstation
        frame = workstation.session.frame
        if phase == "end" or frame is None or not len(frame.nodes):
            self._node = workstation.inputs.drag = None
            return
        if phase == "start":
            if not workstation.session.status.can_drag:
                return
            self._workstation.require_control(self._name)
            self._node = int(np.linalg.norm(frame.nodes - np.array(start), axis=1).argmin())
        if self._node is not None:
            workstation.inputs.drag = DragTarget(node=self._node, target_m=np.array(end, dtype=float))


def points(robot: RobotSpec, frame: SimulationFrame) -> FloatArray:
    """Return the places (P, 3) of the robot's points."""
    return frame.corners.mean(axis=0, keepdims=True) if robot.n_points == 1 else frame.corners.copy()
