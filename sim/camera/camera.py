"""The RGB-D camera beside the table, and pictures for people."""

from __future__ import annotations

import math

import numpy as np
import pybullet as bullet
from numpy.typing import NDArray

from layflat.data.arrays import FloatArray
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.sim.camera.depth_noise import DepthNoise, DepthSensor
from layflat.sim.camera.renderer import Framebuffer, Renderer
from layflat.sim.cloth.cloth import Cloth
from layflat.sim.cloth.mesh import MeshMaker
from layflat.sim.errors import SimError
from layflat.sim.physics.bullet.world import World

D435_NOISE = DepthNoise()
FOCAL_PX = 307.5
"""A D435's colour camera has about 615 px at 640x480; half of that at 320x240."""
POSITION_M = (0.15, -0.72, 0.86)
TARGET_M = (0.285, 0.065, 0.0)
RENDER_POSITION_M = (1.10, -0.90, 0.70)
RENDER_ARM = ((0.16, 0.06, 0.20), 41.0)
"""Where ``render`` looks, m, and its field of view across its height, degrees: with an arm in the picture."""
RENDER_CLOTH = ((0.16, 0.0, 0.18), 31.0)
"""The same without."""
MARKER_RADIUS_M = 0.008
PICKER_RGB = (240.0, 130.0, 30.0)
MARKER_RGB = (200.0, 40.0, 40.0)
HIDDEN = (1.0, 1.0, 1.0, 0.0)


def default_pinhole(*, width: int = 320, height: int = 240) -> PinholeCamera:
    """From the robot's right side, tilted, so that neither the arm nor the hanger stands before the cloth.

    On the table it sees x from -0.15 to 0.75 m and y from -0.25 to 0.25 m, where cloth lies and is dragged.
    """
    return PinholeCamera.look_at(POSITION_M, TARGET_M, width=width, height=height, fx=FOCAL_PX * width / 320)


def render_pinhole(width: int, height: int, *, arm: bool) -> PinholeCamera:
    """From the front and the robot's right: the whole cloth, hanging or laid, and the arm if there is one."""
    target, view_deg = RENDER_ARM if arm else RENDER_CLOTH
    focal = height / 2 / math.tan(math.radians(view_deg) / 2)
    return PinholeCamera.look_at(RENDER_POSITION_M, target, width=width, height=height, fx=focal)


class Camera:
    """Sees the table, the cloth, and every visible body; the table and the cloth are hidden from Bullet's renderer."""

    def __init__(
        self,
        world: World,
        cloth: Cloth,
        *,
        pinhole: PinholeCamera | None = None,
        noise: DepthNoise | None = D435_NOISE,
        seed: int,
    ) -> None:
        """``noise`` None gives the true depth; ``seed`` decides the noise."""
        self._world = world
        self._cloth = cloth
        self._view = Renderer(pinhole or default_pinhole())
        self._render_views: dict[tuple[int, int, bool], Renderer] = {}
        self._sensor = None if noise is None else DepthSensor(noise, seed=seed)
        self._meshes = MeshMaker(cloth.spec)
        self._bodies_seen = -1
        self._has_solids = False
        for body in (world.table, cloth.body):
            bullet.changeVisualShape(body, -1, rgbaColor=HIDDEN, physicsClientId=world.client)

    @property
    def pinhole(self) -> PinholeCamera:
        return self._view.pinhole

    def capture(self, nodes: FloatArray | None = None) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """rgb (H, W, 3) and depth (H, W) m along the optical axis, 0 = missing, of the cloth now or of ``nodes``."""
        picture = self._picture(self._view, self._cloth.nodes() if nodes is None else nodes)
        shape = (self.pinhole.height, self.pinhole.width)
        depth = np.where(np.isfinite(picture.depth), picture.depth, np.float32(0)).reshape(shape)
        if self._sensor is not None:
            depth = self._sensor.measure(depth)
        return picture.rgb.reshape(*shape, 3), depth

    def render(
        self,
        width: int,
        height: int,
        *,
        pinhole: PinholeCamera | None = None,
        nodes: FloatArray | None = None,
        markers: FloatArray | None = None,
    ) -> NDArray[np.uint8]:
        """rgb (height, width, 3) for people, with a shadow, from in front of the robot or from ``pinhole``.

        Small balls show the held corners where there is no arm, and ``markers`` (K, 3) m, such as a disturbing hand.
        """
        view = self._render_view(width, height) if pinhole is None else Renderer(pinhole)
        if (view.pinhole.width, view.pinhole.height) != (width, height):
            raise SimError(
                f"the picture is to be {width}x{height} px, its pinhole has {view.pinhole.width}x{view.pinhole.height}"
            )
        nodes = self._cloth.nodes() if nodes is None else nodes
        picture = self._picture(view, nodes, shadow=True)
        if not self._solids_exist():
            for corner in self._cloth.spec.corners:
                view.draw_ball(picture, nodes[corner], MARKER_RADIUS_M, PICKER_RGB)
        for marker in () if markers is None else markers:
            view.draw_ball(picture, marker, MARKER_RADIUS_M, MARKER_RGB)
        return picture.rgb.reshape(height, width, 3)

    def hidden_share(self, nodes: FloatArray) -> float:
        """Share of the pixels of a cloth at ``nodes`` before which a body stands, 0..1."""
        mesh = self._meshes.mesh(nodes)
        raster = self._view.raster(mesh.vertices, mesh.triangles)
        picture = self._view.blank()
        picture.depth[:] = np.inf
        self._view.draw_solids(picture, self._world.client)
        return float((picture.depth[raster.pixels] < raster.depth).mean())

    def _picture(self, view: Renderer, nodes: FloatArray, *, shadow: bool = False) -> Framebuffer:
        mesh = self._meshes.mesh(nodes)
        picture = view.blank()
        if shadow:
            view.draw_shadow(picture, mesh)
        view.draw_cloth(picture, mesh)
        if self._solids_exist():
            view.draw_solids(picture, self._world.client)
        return picture

    def _render_view(self, width: int, height: int) -> Renderer:
        arm = self._solids_exist()
        key = (width, height, arm)
        if key not in self._render_views:
            self._render_views[key] = Renderer(render_pinhole(width, height, arm=arm))
        return self._render_views[key]

    def _solids_exist(self) -> bool:
        """Whether a body besides the table and the cloth has something to show; asked again when bodies come or go."""
        client = self._world.client
        count = bullet.getNumBodies(physicsClientId=client)
        if count != self._bodies_seen:
            bodies = (bullet.getBodyUniqueId(i, physicsClientId=client) for i in range(count))
            own = {self._world.table, self._cloth.body}
            self._has_solids = any(bullet.getVisualShapeData(b, physicsClientId=client) for b in bodies if b not in own)
            self._bodies_seen = count
        return self._has_solids
