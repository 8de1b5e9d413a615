"""Guide: the hands of one viewer in the scene, which pull at the cloth and guide the robot."""

from __future__ import annotations

from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.web.scene import Scene
from layflat.app.workstation.web.workstation import Workstation
from layflat.data.arrays import FloatArray
from layflat.data.types import DragTarget

GUIDED = ("still", "running", "stopped")
"""States in which the robot follows a hand."""


class Guide:
    """Lets a viewer who may act pull and guide while that has an effect, and tells the workstation."""

    def __init__(self, workstation: Workstation, scene: Scene, name: str) -> None:
        self._workstation = workstation
        self._scene = scene
        self._name = name
        """Name of the viewer."""
        self._allowed = (False, False)

    def update(self, frame: SimulationFrame | None) -> None:
        """Offer what is possible with the frame that is shown."""
        session = self._workstation.session
        acts = (
            frame is not None and frame is session.frame and session.alive and self._workstation.in_control(self._name)
        )
        guides = acts and session.status.source == "kinesthetic" and session.status.state in GUIDED
        allowed = (acts and session.status.can_drag, guides)
        before, self._allowed = self._allowed, allowed
        if allowed[0] != before[0]:
            self._scene.let_drag(self._pulled if allowed[0] else None)
        if allowed[1] != before[1]:
            self._scene.let_guide(self._guided if allowed[1] else None)

    def _pulled(self, client_id: int, drag: DragTarget | None) -> None:
        def pull() -> None:
            self._workstation.require_control(self._name)
            self._workstation.inputs.drag = drag

        self._workstation.post(pull, client_id)

    def _guided(self, client_id: int, hand: FloatArray | None) -> None:
        def guide() -> None:
            self._workstation.require_control(self._name)
            self._workstation.inputs.hand = hand

        self._workstation.post(guide, client_id)
