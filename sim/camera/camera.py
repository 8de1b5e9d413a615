"""Camera: the RGB-D camera beside the table, and images for people."""

from __future__ import annotations

import copy
import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from layflat.data.arrays import FloatArray
from layflat.data.camera import CameraModel
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.sim.camera.depth_noise import DepthNoise, DepthSensor
from layflat.sim.camera.renderer import USUAL_LIGHT, Framebuffer, Light, Renderer
from layflat.sim.cloth.mesh import MeshMaker
from layflat.sim.cloth.spec import ClothSpec
from layflat.sim.conditions.keys import CAMERA_WIDTH_PX, Conditions
from layflat.sim.errors import SimError
from layflat.sim.physics.base import Cloth

D435_NOISE = DepthNoise()
FOCAL_PX = 307.5
"""A D435's colour camera has about 615 px at 640x480; half of that at 320x240."""
POSITION_M = (0.15, -0.72, 0.86)
TARGET_M = (0.285, 0.065, 0.0)
BEHIND_POSITION_M, BEHIND_TARGET_M = (-0.52, 0.0, 0.95), (0.25, 0.0, 0.0)
RENDER_POSITION_M = (1.10, -0.90, 0.70)
RENDER_ARM = ((0.16, 0.06, 0.20), 41.0)
"""Target of ``render``, m, and its field of view across its height, degrees, with an arm in the image."""
RENDER_CLOTH = ((0.16, 0.0, 0.18), 31.0)
"""The same without an arm."""
MARKER_RADIUS_M = 0.008
PICKER_RGB = (240.0, 130.0, 30.0)
MARKER_RGB = (200.0, 40.0, 40.0)


def default_pinhole(
    cloth: ClothSpec | None = None, *, width: int = CAMERA_WIDTH_PX, height: int | None = None, behind: bool = False
) -> PinholeCamera:
    """Return the camera at the robot's right side, tilted, so that neither arm nor hanger stands before the cloth.

    On the table it sees x from -0.15 to 0.75 m and y from -0.25 to 0.25 m, where cloth lies and is dragged. For a cloth
    larger than the towel it sees as much more, most of it by a wider lens: depth noise grows with the distance.
    ``behind``: over where the cloth hangs at first, for arms on both sides.
    """
    height = round(width * 3 / 4) if height is None else height
    size, home = (1.0, 0.0) if cloth is None else (cloth.size, cloth.home_x_m)
    away = size**0.25
    place, aim = (BEHIND_POSITION_M, BEHIND_TARGET_M) if behind else (POSITION_M, TARGET_M)
    position = np.array(place) * [size, away, away] + [home, 0.0, 0.0]
    target = np.array(aim) * size + [home, 0.0, 0.0]
    return PinholeCamera.look_at(position, target, width=width, height=height, fx=FOCAL_PX * width / 320 * away / size)


def recorded_pinhole(camera: CameraModel | None, cloth: ClothSpec | None = None) -> PinholeCamera:
    """Return the camera of an episode, or the usual one where it is not known."""
    return default_pinhole(cloth) if camera is None else PinholeCamera(**vars(camera))


def pinhole_of(conditions: Conditions, cloth: ClothSpec | None = None, *, behind: bool = False) -> PinholeCamera:
    """Return the camera as conditions place it: moved without a turn, then tilted."""
    usual = default_pinhole(cloth, width=conditions.camera_width_px, behind=behind)
    moved = (conditions.camera_x_m, conditions.camera_y_m, conditions.camera_z_m)
    if not any((*moved, conditions.camera_tilt_deg)):
        return usual
    pose, tilt = usual.cam_to_world.copy(), math.radians(conditions.camera_tilt_deg)
    pose[:3, 3] += moved
    sine, cosine = math.sin(tilt), math.cos(tilt)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])
    pose[:3, :3] = pose[:3, :3] @ turn
    return replace(usual, cam_to_world=pose)


def noise_of(conditions: Conditions) -> DepthNoise | None:
    """Return the depth camera's errors under conditions; None for none."""
    factor, usual = conditions.depth_noise, D435_NOISE
    if factor == 0:
        return None
    return replace(usual, subpixel_px=factor * usual.subpixel_px, missing_share=factor * usual.missing_share)


class Camera:
    """Sees the table, the cloth, and every visible body of the world."""

    def __init__(
        self,
        cloth: Cloth,
        *,
        pinhole: PinholeCamera | None = None,
        noise: DepthNoise | None = D435_NOISE,
        light: Light = USUAL_LIGHT,
        seed: int,
    ) -> None:
        """``noise`` None gives the true depth; ``seed`` determines the noise."""
        self._light = light
        self._world = cloth.world
        self._cloth = cloth
        self._renderer = Renderer(pinhole or default_pinhole(cloth.spec), light)
        self._render_views: dict[tuple[int, int, bool], Renderer] = {}
        self._sensor = None if noise is None else DepthSensor(noise, seed=seed)
        self._meshes = MeshMaker(cloth.spec)

    def save(self) -> DepthSensor | None:
        """Return the state of the sensor's noise, for `restore`."""
        return copy.deepcopy(self._sensor)

    def restore(self, state: DepthSensor | None) -> None:
        """Go on with the noise of a state that `save` gave."""
        self._sensor = copy.deepcopy(state)

    @property
    def pinhole(self) -> PinholeCamera:
        """The camera model of `capture`."""
        return self._renderer.pinhole

    def capture(self, nodes: FloatArray | None = None) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Return rgb (H, W, 3) and depth (H, W) m along the optical axis, 0 = missing, of the cloth or of ``nodes``."""
        image = self._image(self._renderer, self._cloth.nodes() if nodes is None else nodes)
        shape = (self.pinhole.height, self.pinhole.width)
        depth = np.where(np.isfinite(image.depth), image.depth, np.float32(0)).reshape(shape)
        if self._sensor is not None:
            depth = self._sensor.measure(depth)
        return image.rgb.reshape(*shape, 3), depth

    def render(
        self,
        width: int,
        height: int,
        *,
        pinhole: PinholeCamera | None = None,
        nodes: FloatArray | None = None,
        markers: FloatArray | None = None,
    ) -> NDArray[np.uint8]:
        """Return rgb (height, width, 3) for people, with a shadow, from in front of the robot or from ``pinhole``.

        Small balls show the held corners where there is no arm, and ``markers`` (K, 3) m, such as a disturbing hand.
        """
        view = self._view_for_people(width, height) if pinhole is None else Renderer(pinhole, self._light)
        if (view.pinhole.width, view.pinhole.height) != (width, height):
            raise SimError(
                f"the image is {width}x{height} px, but its pinhole has {view.pinhole.width}x{view.pinhole.height}"
            )
        nodes = self._cloth.nodes() if nodes is None else nodes
        image = self._image(view, nodes, shadow=True)
        if not self._world.solids:
            for corner in self._cloth.spec.corners:
                view.draw_ball(image, nodes[corner], MARKER_RADIUS_M, PICKER_RGB)
        for marker in () if markers is None else markers:
            view.draw_ball(image, marker, MARKER_RADIUS_M, MARKER_RGB)
        return image.rgb.reshape(height, width, 3)

    def _image(self, view: Renderer, nodes: FloatArray, *, shadow: bool = False) -> Framebuffer:
        mesh = self._meshes.mesh(nodes)
        image = view.background()
        if shadow:
            view.draw_shadow(image, mesh)
        view.draw_cloth(image, mesh)
        for solid in self._world.solids:
            view.draw_solid(image, *solid.mesh())
        return image

    def _view_for_people(self, width: int, height: int) -> Renderer:
        """Return a view from in front of the whole cloth, hanging or laid, and of the arm if there is one."""
        arm = bool(self._world.solids)
        key = (width, height, arm)
        if key not in self._render_views:
            target, view_deg = RENDER_ARM if arm else RENDER_CLOTH
            focal = height / 2 / math.tan(math.radians(view_deg) / 2)
            pinhole = PinholeCamera.look_at(RENDER_POSITION_M, target, width=width, height=height, fx=focal)
            self._render_views[key] = Renderer(pinhole, self._light)
        return self._render_views[key]
