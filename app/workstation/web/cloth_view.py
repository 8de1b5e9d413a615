"""ClothView: the meshes of a cloth in the browser, each of one color; computed once for all viewers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from viser import SceneApi

from layflat.app.media import cloth_colors as colors
from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.web.stage import SHADOW_M
from layflat.data.arrays import FloatArray
from layflat.sim.cloth.mesh import MeshMaker
from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.cloth.spec import ClothSpec

SUBDIVISIONS = 2
LIFT_M = 0.0015
"""Height of fold lines above the cloth."""
GHOST_OPACITY = 0.28
LOOKS: tuple[tuple[str, colors.Rgb, Any], ...] = (
    ("face", colors.FACE, "front"), ("check", colors.FACE_CHECK, "front"), ("reverse", colors.REVERSE, "back"),
)  # fmt: skip
"""Name, color and visible side of each part."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Surface:
    """A cloth as it is drawn."""

    parts: list[NDArray[np.float32]]
    """Vertices of each of LOOKS."""
    rests: NDArray[np.uint32]
    """Triangles of the nodes that rest on the table."""
    raised: NDArray[np.float32]
    """Nodes, above the cloth by LIFT_M."""
    shadow: NDArray[np.float32]
    """Nodes, on the table."""
    folds: list[NDArray[np.float32]]
    """Rim and line of the folds."""


class Painter:
    """Divides a kind of cloth into meshes, each of one color and with its own vertices."""

    def __init__(self, spec: ClothSpec) -> None:
        self.spec = spec
        self._maker = MeshMaker(spec, subdivisions=SUBDIVISIONS)
        self._paint = colors.ClothPaint(spec, subdivisions=SUBDIVISIONS)
        self._contact = colors.ClothPaint(spec, subdivisions=1)
        self.coarse = self._contact.triangles.astype(np.uint32)
        """Triangles of the nodes."""
        checked, all_ = self._paint.checked, self._paint.triangles
        self.parts = [np.unique(kept, return_inverse=True) for kept in (all_[~checked], all_[checked], all_)]
        """Vertices and triangles of each of LOOKS."""
        self.surface = lru_cache(maxsize=16)(self._surface)

    def _surface(self, frame: SimulationFrame) -> Surface:
        nodes = frame.nodes
        mesh = self._maker.mesh(nodes)
        lines = self._paint.fold_lines(mesh)
        return Surface(
            parts=[mesh.vertices[used].astype(np.float32) for used, _ in self.parts],
            rests=self.coarse[self._contact.resting(nodes)],
            raised=_raised(nodes, LIFT_M),
            shadow=_raised(nodes * [1.0, 1.0, 0.0], SHADOW_M),
            folds=[_raised(lines, (k + 1) * LIFT_M) for k in range(2)],
        )


@lru_cache(maxsize=8)
def painter_of(cloth: str) -> Painter:
    """Return the painter of a cloth by its name."""
    return Painter(cloth_spec(cloth))


class ClothView:
    """The cloth's meshes in one scene."""

    def __init__(self, scene: SceneApi, parent: str, frame: SimulationFrame) -> None:
        self.painter = painter_of(frame.cloth)
        nodes, faces, surface = frame.nodes, self.painter.coarse, self.painter.surface(frame)
        name = f"{parent}/cloth"
        self.root = scene.add_frame(name, show_axes=False)

        def add(part: str, vertices: Any, triangles: Any, color: colors.Rgb, side: Any = "double", **look: Any) -> Any:
            look |= {"color": color, "side": side, "cast_shadow": False, "receive_shadow": False}
            return scene.add_mesh_simple(f"{name}/{part}", vertices, triangles, **look)

        self._parts = [
            add(part, vertices, own.reshape(-1, 3), rgb, side)
            for (part, rgb, side), vertices, (_, own) in zip(LOOKS, surface.parts, self.painter.parts, strict=True)
        ]
        self._rests = add("contact", nodes, faces[:0], colors.CONTACT_SHADE, opacity=colors.CONTACT_SHARE)
        self._shadow = add("shadow", nodes, faces, colors.SHADOW)
        self._ghost = add("ghost", nodes, faces, colors.GHOST, opacity=GHOST_OPACITY, visible=False)
        self._folds = [
            scene.add_line_segments(
                f"{name}/{line}", np.zeros((0, 2, 3)), rgb, thickness=wide, thickness_units="screen"
            )
            for line, rgb, wide in (("fold rim", colors.FOLD_RIM, 9.0), ("fold", colors.FOLD, 5.0))
        ]

    def show(self, frame: SimulationFrame) -> None:
        """Move the cloth, its shadow straight below it, what is shaded, and the lines of its folds."""
        surface = self.painter.surface(frame)
        for handle, vertices in zip(self._parts, surface.parts, strict=True):
            handle.vertices = vertices
        if len(surface.rests):
            self._rests.vertices = surface.raised
        self._rests.faces = surface.rests
        self._shadow.vertices = surface.shadow
        for line, points in zip(self._folds, surface.folds, strict=True):
            line.points = points

    def show_ghost(self, nodes: FloatArray | None) -> None:
        """Show a second cloth, or none."""
        self._ghost.visible = nodes is not None and len(nodes) == self.painter.spec.n_nodes
        if nodes is not None and self._ghost.visible:
            self._ghost.vertices = nodes.astype(np.float32)

    def let_drag(self, callback: Callable[[Any], Any] | None) -> None:
        """Call back on each drag with the left button, or let it turn the camera (None)."""
        for handle in self._parts:
            handle.remove_drag_callback()
            if callback is not None:
                handle.on_drag("left")(callback)


def _raised(points: FloatArray, by_m: float) -> NDArray[np.float32]:
    return (points + np.array([0.0, 0.0, by_m])).astype(np.float32)
