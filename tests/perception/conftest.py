"""A wrinkled sheet on a table, drawn analytically: what the perception tests look at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pytest
from numpy.typing import NDArray

from perception.pinhole import Pinhole

Field = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]

TABLE_RGB = (205.0, 205.0, 200.0)
CLOTH_RGB = (40.0, 90.0, 200.0)


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """A rectangular sheet with sine wrinkles; all lengths in metres, angles in rad."""

    centre: tuple[float, float] = (0.25, 0.0)
    size: tuple[float, float] = (0.35, 0.35)
    yaw: float = 0.0
    rest: float = 0.004
    """Height of the wrinkles' troughs."""
    amplitude: float = 0.0
    """Of the sine: crests are at rest + 2 amplitude."""
    wavelength: float = 0.058
    normal: float = 0.0
    """Angle of the wrinkles' perpendicular from +x."""
    phase: float = 0.7
    lift_x: float = np.inf
    """From here on towards +x the sheet rises ..."""
    lift_slope: float = 0.5
    """... by this much per metre."""

    @property
    def level(self) -> bool:
        return self.amplitude == 0 and self.lift_x == np.inf

    def height(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        along = x * np.cos(self.normal) + y * np.sin(self.normal)
        wave = self.amplitude * (1 + np.sin(2 * np.pi * along / self.wavelength + self.phase))
        return self.rest + wave + self.lift_slope * np.clip(x - self.lift_x, 0, None)

    def covers(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
        dx, dy = x - self.centre[0], y - self.centre[1]
        u = dx * np.cos(self.yaw) + dy * np.sin(self.yaw)
        v = -dx * np.sin(self.yaw) + dy * np.cos(self.yaw)
        return (np.abs(u) <= self.size[0] / 2) & (np.abs(v) <= self.size[1] / 2)


@dataclass(frozen=True)
class Frame:
    rgb: NDArray[np.uint8]
    depth: NDArray[np.float32]


@lru_cache(maxsize=8)
def world_rays(camera: Pinhole, factor: int) -> NDArray[np.float64]:
    """(3, rows, columns): world directions of unit depth through the pixels of a ``factor`` times finer image."""
    u = (np.arange(camera.width * factor) + 0.5) / factor - 0.5
    v = (np.arange(camera.height * factor) + 0.5) / factor - 0.5
    columns, rows = np.meshgrid((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy)
    return np.tensordot(camera.cam_to_world[:3, :3], np.stack([columns, rows, np.ones_like(rows)]), axes=1)


def hit(camera: Pinhole, level: NDArray[np.float64] | float, factor: int) -> tuple[NDArray, NDArray, NDArray]:
    """x, y and depth where the rays meet height ``level``."""
    rays = world_rays(camera, factor)
    depth = (level - camera.position[2]) / rays[2]
    return camera.position[0] + depth * rays[0], camera.position[1] + depth * rays[1], depth


def draw(
    camera: Pinhole,
    sheet: Sheet | None,
    *,
    light: tuple[float, float, float] = (1.0, 1.0, 1.4),
    ambient: float = 0.4,
    exposure: float = 1.0,
    seed: int | None = None,
    rgb_noise: float = 3.0,
    depth_noise: float = 0.0025,
    missing: float = 0.0,
    factor: int = 2,
) -> Frame:
    """Ray-cast sheet and table with Lambert shading; with a seed, sensor noise (grey levels, m) and missing depth."""
    x, y, depth = hit(camera, 0.0, factor)
    shade = np.ones(x.shape)
    cloth = np.zeros(x.shape, dtype=bool)
    if sheet is not None:
        xs, ys, ds = x, y, depth
        for _ in range(1 if sheet.level else 6):  # fixed point: gentle slopes only
            xs, ys, ds = hit(camera, sheet.height(xs, ys), factor)
        cloth = sheet.covers(xs, ys)
        depth = np.where(cloth, ds, depth)
        step = 1e-5
        gx = (sheet.height(xs + step, ys) - sheet.height(xs - step, ys)) / (2 * step)
        gy = (sheet.height(xs, ys + step) - sheet.height(xs, ys - step)) / (2 * step)
        sun = np.array(light) / np.linalg.norm(light)
        facing = (sun[2] - gx * sun[0] - gy * sun[1]) / np.sqrt(1 + gx**2 + gy**2)
        shade = np.where(cloth, ambient + (1 - ambient) * np.clip(facing, 0, None), 1.0)
    colour = np.where(cloth[..., None], CLOTH_RGB, TABLE_RGB) * shade[..., None] * exposure
    shape = (camera.height, factor, camera.width, factor)
    rgb = colour.reshape(*shape, 3).mean(axis=(1, 3))
    depth = (
        depth.reshape(shape)[:, factor // 2, :, factor // 2] if factor == 1 else depth.reshape(shape).mean(axis=(1, 3))
    )
    if seed is not None:
        rng = np.random.default_rng(seed)
        rgb = rgb + rng.normal(0, rgb_noise, rgb.shape)
        depth = np.round((depth + rng.normal(0, depth_noise, depth.shape)) / 0.001) * 0.001
        depth[rng.random(depth.shape) < missing] = 0.0
    return Frame(np.clip(np.rint(rgb), 0, 255).astype(np.uint8), depth.astype(np.float32))


@pytest.fixture(scope="session")
def tilted_camera() -> Pinhole:
    """Beside the table, about 51 degrees above the horizontal."""
    return Pinhole.look_at((0.25, -0.6, 0.75), (0.25, 0.0, 0.0), width=320, height=240, fx=307.0)


@pytest.fixture(scope="session")
def make_sheet() -> type[Sheet]:
    return Sheet


@pytest.fixture(scope="session")
def draw_sheet() -> Callable[..., Frame]:
    return draw
