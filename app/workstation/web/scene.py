"""Scene: cloth and robot in 3D (placeholder)."""

from __future__ import annotations

from typing import Any

import numpy as np

from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.sim.cloth.spec import cloth_spec


class Scene:
    """The newest frame in viser's scene."""

    def __init__(self, scene: Any) -> None:
        self._scene = scene
        self.cloth: Any = None

    def show(self, frame: SimulationFrame) -> None:
        """Show a frame."""
        if not len(frame.nodes):
            return
        if self.cloth is None or len(self.cloth.vertices) != len(frame.nodes):
            faces = np.array(cloth_spec(frame.cloth).triangles())
            self.cloth = self._scene.add_mesh_simple("/cloth", frame.nodes, faces, side="double")
        self.cloth.vertices = frame.nodes.astype(np.float32)
