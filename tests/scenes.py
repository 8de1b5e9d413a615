"""Ray-cast RGB-D frames of a cloth on a table in a room, from any camera pose, with the ground truth.

Unlike a synthetic sheet, a scene has a table edge, a floor, a box, any colours and any image size, and a D435's errors:
noise that grows with the square of the depth, missing blots, whole millimetres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from layflat.perception.camera.intrinsics import Intrinsics
from layflat.perception.camera.pinhole import PinholeCamera

Rgb = tuple[float, float, float]

CLOTHS: dict[str, Rgb] = {
    "red": (190, 35, 40),
    "orange": (225, 115, 30),
    "yellow": (220, 195, 50),
    "green": (45, 140, 70),
    "cyan": (40, 160, 170),
    "blue": (40, 90, 200),
    "violet": (110, 60, 170),
    "pink": (225, 110, 150),
}
TABLES: dict[str, Rgb] = {
    "white": (225, 225, 220),
    "warm white": (225, 218, 200),
    "grey": (150, 152, 155),
    "dark grey": (70, 72, 75),
}
WOOD: Rgb = (165, 125, 85)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Cloth, table and light; lengths in metres, angles in degrees, table top at z = 0."""

    cloth: Rgb = CLOTHS["blue"]
    table: Rgb = TABLES["white"]
    centre: tuple[float, float] = (0.0, 0.0)
    side: float = 0.35
    yaw: float = 10.0
    rest: float = 0.004
    amplitude: float = 0.002
    wavelength: float = 0.058
    normal: float = 30.0
    """Angle of the wrinkles' perpendicular from +x."""
    lift_from: float = math.inf
    """The cloth rises at 1:2 beyond this x."""
    table_half: tuple[float, float] = (0.8, 0.7)
    floor_z: float = -0.75
    floor: Rgb = (118, 112, 106)
    box: Rgb | None = None
    """Colour of a 12 cm box on the table, in the image's upper left."""
    box_at: tuple[float, float] = (-0.36, 0.26)
    light: tuple[float, float, float] = (1.0, 1.0, 1.4)
    ambient: float = 0.4

    def height(self, x: NDArray, y: NDArray) -> NDArray:
        angle = math.radians(self.normal)
        along = x * math.cos(angle) + y * math.sin(angle)
        wave = self.amplitude * (1 + np.sin(2 * math.pi * along / self.wavelength + 0.7))
        return self.rest + wave + 0.5 * np.clip(x - self.lift_from, 0, None)

    def covers(self, x: NDArray, y: NDArray) -> NDArray:
        angle = math.radians(self.yaw)
        dx, dy = x - self.centre[0], y - self.centre[1]
        u, v = dx * math.cos(angle) + dy * math.sin(angle), dy * math.cos(angle) - dx * math.sin(angle)
        return np.maximum(np.abs(u), np.abs(v)) <= self.side / 2


@dataclass(frozen=True, kw_only=True)
class Shot:
    """Frame of a scene, with the ground truth."""

    rgb: NDArray[np.uint8]
    depth: NDArray[np.float32]
    """m, 0 where missing."""
    cloth: NDArray[np.bool_]
    """Pixels of the cloth."""
    camera: PinholeCamera
    lens: Intrinsics = field(repr=False)

    def save(self, folder: Path, name: str = "frame") -> tuple[Path, Path]:
        """Save rgb and 16-bit depth in millimetres, as a RealSense user does."""
        rgb, depth = folder / f"{name}-rgb.png", folder / f"{name}-depth.png"
        cv2.imwrite(str(rgb), self.rgb[..., ::-1])
        cv2.imwrite(str(depth), np.rint(self.depth * 1000).astype(np.uint16))
        return rgb, depth


def stand(*, tilt=40.0, roll=0.0, distance=0.8, width=640, height=480, turn=0.0) -> tuple[PinholeCamera, Intrinsics]:
    """Return a D435 ``distance`` from the origin, ``tilt`` degrees from above, rolled, turned round the table."""
    a, t, r = (math.radians(angle) for angle in (turn, tilt, roll))
    eye = distance * np.array([math.sin(t) * math.sin(a), -math.sin(t) * math.cos(a), math.cos(t)])
    forward = -eye / distance
    right = np.array([math.cos(a), math.sin(a), 0.0])
    down = np.cross(forward, right)
    lens = Intrinsics.d435(width, height)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack(
        [math.cos(r) * right + math.sin(r) * down, math.cos(r) * down - math.sin(r) * right, forward]
    )
    pose[:3, 3] = eye
    return lens.camera_at(pose), lens


def shoot(
    scene: Scene,
    camera: PinholeCamera,
    lens: Intrinsics,
    *,
    seed: int | None = None,
    depth_noise: float = 0.0026,
    missing: float = 0.01,
    rgb_noise: float = 3.0,
) -> Shot:
    """Render the scene; with a seed, with sensor noise. ``depth_noise`` is m rms at 1 m, ``missing`` a share."""
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    slopes = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(columns.shape)])
    rays = np.tensordot(camera.cam_to_world[:3, :3], slopes, axes=1)
    x, y, depth = _hit(camera, rays, 0.0)
    on_table = (np.abs(x) <= scene.table_half[0]) & (np.abs(y) <= scene.table_half[1]) & (depth > 0)
    floor = _hit(camera, rays, scene.floor_z)[2]
    depth = np.where(on_table, depth, np.where(floor > 0, floor, 0.0))
    rgb = np.where(on_table[..., None], scene.table, scene.floor)
    xs, ys, ds = x, y, depth
    for _ in range(6):
        xs, ys, ds = _hit(camera, rays, scene.height(xs, ys))
    cloth = scene.covers(xs, ys) & (ds > 0)
    depth = np.where(cloth, ds, depth)
    rgb = np.where(cloth[..., None], np.array(scene.cloth) * _shade(scene, xs, ys)[..., None], rgb)
    if scene.box is not None:
        xb, yb, db = _hit(camera, rays, 0.12)
        box = (np.abs(xb - scene.box_at[0]) < 0.06) & (np.abs(yb - scene.box_at[1]) < 0.06)
        depth, rgb = np.where(box, db, depth), np.where(box[..., None], scene.box, rgb)
    if seed is not None:
        rng = np.random.default_rng(seed)
        rgb = cv2.GaussianBlur(rgb, (3, 3), 0.6) + rng.normal(0, rgb_noise, rgb.shape)
        depth = _add_depth_errors(depth, rng, depth_noise, missing)
    rgb = np.clip(np.rint(rgb), 0, 255).astype(np.uint8)
    return Shot(rgb=rgb, depth=depth.astype(np.float32), cloth=cloth, camera=camera, lens=lens)


def _hit(camera: PinholeCamera, rays: NDArray, level: NDArray | float) -> tuple[NDArray, NDArray, NDArray]:
    depth = (level - camera.position[2]) / rays[2]
    return camera.position[0] + depth * rays[0], camera.position[1] + depth * rays[1], depth


def _shade(scene: Scene, x: NDArray, y: NDArray) -> NDArray:
    step = 1e-5
    gx = (scene.height(x + step, y) - scene.height(x - step, y)) / (2 * step)
    gy = (scene.height(x, y + step) - scene.height(x, y - step)) / (2 * step)
    sun = np.array(scene.light) / np.linalg.norm(scene.light)
    facing = (sun[2] - gx * sun[0] - gy * sun[1]) / np.sqrt(1 + gx**2 + gy**2)
    return scene.ambient + (1 - scene.ambient) * np.clip(facing, 0, None)


def _add_depth_errors(depth: NDArray, rng: np.random.Generator, noise: float, missing: float) -> NDArray:
    """Add errors that neighbours share and that are constant in 1/z, blots without a value, whole millimetres."""
    field = cv2.GaussianBlur(rng.normal(size=depth.shape), (0, 0), 1.0)
    measured = 1 / np.maximum(1 / np.where(depth > 0, depth, 9.0) + noise * field / field.std(), 0.05)
    blots = cv2.GaussianBlur(rng.normal(size=depth.shape), (0, 0), 3.0)
    gone = blots < np.quantile(blots, missing)
    return np.where((depth > 0) & ~gone, np.round(measured, 3), 0.0)
