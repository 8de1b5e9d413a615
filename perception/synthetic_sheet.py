"""A wrinkled sheet on a table, drawn analytically: test material whose wrinkles, contact and light are known exactly.

Ray-cast with Lambert shading from one distant light and an ambient part, without a simulator: what a descriptor says of
these frames can be held against the numbers that they were made from.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.errors import PerceptionError

Array: TypeAlias = NDArray[np.float64]
Rgb: TypeAlias = tuple[float, float, float]

TABLE_RGB: Rgb = (205.0, 205.0, 200.0)
CLOTH_RGB: Rgb = (40.0, 90.0, 200.0)
STEP_M = 1e-5
"""Of the differences that give the slopes."""
STEEPEST = 0.9
"""The rays' fixed point converges where the surface is less steep than this against them."""
SHADOW_SAMPLES = 24


@dataclass(frozen=True, kw_only=True)
class Wave:
    """Sine wrinkles: height rises from 0 to 2 amplitude_m and back within one wavelength_m."""

    normal: float = 0.0
    """Angle of the wrinkles' perpendicular from +x, rad."""
    wavelength_m: float = 0.058
    amplitude_m: float = 0.002
    phase: float = 0.7
    """rad"""

    def __post_init__(self) -> None:
        if not (self.wavelength_m > 0 and self.amplitude_m >= 0):
            raise PerceptionError(f"{self}: the wavelength must be positive and the amplitude not negative")
        if self.slope > STEEPEST:
            raise PerceptionError(
                f"{self} is as steep as {self.slope:.2f}; at most {STEEPEST} can be drawn: use a longer wavelength"
            )

    @property
    def slope(self) -> float:
        """Greatest slope, m/m."""
        return 2 * math.pi * self.amplitude_m / self.wavelength_m

    def height(self, x: Array, y: Array) -> Array:
        """m above the trough, at table points (x, y) m."""
        along = x * math.cos(self.normal) + y * math.sin(self.normal)
        return self.amplitude_m * (1 + np.sin(2 * math.pi * along / self.wavelength_m + self.phase))


@dataclass(frozen=True, kw_only=True)
class SyntheticSheet:
    """A rectangular sheet; lengths in metres, angles in rad, table coordinates."""

    centre: tuple[float, float] = (0.25, 0.0)
    size: tuple[float, float] = (0.35, 0.35)
    yaw: float = 0.0
    rest_m: float = 0.004
    """Height of the wrinkles' troughs."""
    waves: tuple[Wave, ...] = ()
    """Their heights add up; none is a flat sheet."""
    lift_x_m: float = math.inf
    """From here on towards +x the sheet rises ..."""
    lift_slope: float = 0.5
    """... by this much per metre."""
    rgb: Rgb = CLOTH_RGB

    @property
    def level(self) -> bool:
        return not any(wave.amplitude_m for wave in self.waves) and self.lift_x_m == math.inf

    def height(self, x: Array, y: Array) -> Array:
        """m above the table."""
        height = self.rest_m + self.lift_slope * np.clip(x - self.lift_x_m, 0.0, None)
        for wave in self.waves:
            height = height + wave.height(x, y)
        return height

    def slopes(self, x: Array, y: Array) -> tuple[Array, Array]:
        """dh/dx and dh/dy."""
        return (
            (self.height(x + STEP_M, y) - self.height(x - STEP_M, y)) / (2 * STEP_M),
            (self.height(x, y + STEP_M) - self.height(x, y - STEP_M)) / (2 * STEP_M),
        )

    def covers(self, x: Array, y: Array) -> NDArray[np.bool_]:
        """Where the sheet is, seen from straight above."""
        dx, dy = x - self.centre[0], y - self.centre[1]
        along = dx * math.cos(self.yaw) + dy * math.sin(self.yaw)
        across = -dx * math.sin(self.yaw) + dy * math.cos(self.yaw)
        return (np.abs(along) <= self.size[0] / 2) & (np.abs(across) <= self.size[1] / 2)


@dataclass(frozen=True, kw_only=True)
class Light:
    """A distant lamp, the rest of the room, and the camera's exposure."""

    azimuth_deg: float = 45.0
    """Direction on the table towards the lamp, from +x."""
    elevation_deg: float = 45.0
    """Height of the lamp: 90 stands straight above."""
    ambient: float = 0.4
    """Share of the light that comes from everywhere, 0..1."""
    exposure: float = 1.0
    """Factor on all brightness; what exceeds 255 is cut off, as in a camera."""
    tint: Rgb = (1.0, 1.0, 1.0)
    """Factor on each channel: a lamp's colour, or a white balance that has drifted."""
    shaded_from_m: float = math.inf
    """Something stands in the lamp's way: beyond this y only the ambient part is left (a soft edge of 10 mm)."""

    def __post_init__(self) -> None:
        if not (0 < self.elevation_deg <= 90 and 0 <= self.ambient <= 1 and self.exposure > 0):
            raise PerceptionError(f"{self}: elevation must lie in (0, 90] degrees, ambient in 0..1, exposure above 0")

    @property
    def towards(self) -> Array:
        """(3,) unit vector to the lamp, world."""
        azimuth, elevation = math.radians(self.azimuth_deg), math.radians(self.elevation_deg)
        level = math.cos(elevation)
        return np.array([level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation)])


@dataclass(frozen=True)
class RgbdFrame:
    """What a camera sees."""

    rgb: NDArray[np.uint8]
    """(H, W, 3)"""
    depth: NDArray[np.float32]
    """(H, W) m along the optical axis; 0 where missing."""


@dataclass(frozen=True, kw_only=True)
class RenderConfig:
    """How a sheet is drawn."""

    light: Light = field(default_factory=Light)
    table_rgb: Rgb = TABLE_RGB
    rgb_noise: float = 0.0
    """Grey levels, standard deviation."""
    depth_noise_m: float = 0.0
    """Standard deviation; depth then also comes in whole millimetres."""
    missing: float = 0.0
    """Share of the depth pixels without a value."""
    seed: int = 0
    """Of the noise."""
    samples: int = 2
    """Rays per pixel along each axis."""

    def noisy(self, seed: int) -> RenderConfig:
        """The same with the noise of a small colour camera and of a D435 at 1 m."""
        return replace(self, rgb_noise=3.0, depth_noise_m=0.0025, missing=0.02, seed=seed)


def render_sheet(camera: PinholeCamera, sheet: SyntheticSheet | None, drawing: RenderConfig | None = None) -> RgbdFrame:
    """What ``camera`` sees of the sheet on its table; None draws the table alone."""
    how = RenderConfig() if drawing is None else drawing
    x, y, depth = _meet(camera, 0.0, how.samples)
    brightness = np.full(x.shape, how.light.ambient) + (1 - how.light.ambient) * _unshaded(how.light, y)
    albedo = np.broadcast_to(np.array(how.table_rgb), (*x.shape, 3))
    if sheet is not None:
        xs, ys, ds = x, y, depth
        for _ in range(1 if sheet.level else 8):
            xs, ys, ds = _meet(camera, sheet.height(xs, ys), how.samples)
        cloth = sheet.covers(xs, ys)
        depth = np.where(cloth, ds, depth)
        brightness = np.where(cloth, _shading(sheet, how.light, xs, ys), brightness)
        albedo = np.where(cloth[..., None], sheet.rgb, albedo)
    colour = albedo * (brightness[..., None] * how.light.exposure * np.array(how.light.tint))
    return _sensed(_pooled(camera, colour, how.samples), _pooled(camera, depth, how.samples), how)


def _shading(sheet: SyntheticSheet, light: Light, x: Array, y: Array) -> Array:
    """Brightness at points of the sheet; 1 for one that faces the lamp, ambient for one in shadow."""
    lamp = light.towards
    gx, gy = sheet.slopes(x, y)
    facing = (lamp[2] - gx * lamp[0] - gy * lamp[1]) / np.sqrt(1 + gx**2 + gy**2)
    lit = np.clip(facing, 0.0, None) * _unshaded(light, y) * ~_self_shadow(sheet, light, x, y)
    return light.ambient + (1 - light.ambient) * lit


def _self_shadow(sheet: SyntheticSheet, light: Light, x: Array, y: Array) -> NDArray[np.bool_]:
    """Where a crest stands between the sheet and the lamp."""
    lamp = light.towards
    level = math.hypot(lamp[0], lamp[1])
    highest = sum(2 * wave.amplitude_m for wave in sheet.waves)
    shadow = np.zeros(x.shape, dtype=bool)
    steepest = sum(wave.slope for wave in sheet.waves)
    if highest == 0 or level < 1e-9 or steepest * level < lamp[2]:
        return shadow
    here = sheet.height(x, y)
    reach = min(highest * level / lamp[2], 0.2)
    for distance in np.linspace(0.0, reach, SHADOW_SAMPLES + 1)[1:]:
        above = sheet.height(x + distance * lamp[0] / level, y + distance * lamp[1] / level)
        shadow |= above > here + distance * lamp[2] / level + 1e-5
    return shadow


def _unshaded(light: Light, y: Array) -> Array:
    """Share of the lamp's light that comes past what stands in its way."""
    return np.clip((light.shaded_from_m - y) / 0.010 + 0.5, 0.0, 1.0)


def _sensed(rgb: Array, depth: Array, how: RenderConfig) -> RgbdFrame:
    rng = np.random.default_rng(how.seed)
    if how.rgb_noise:
        rgb = rgb + rng.normal(0.0, how.rgb_noise, rgb.shape)
    if how.depth_noise_m:
        depth = np.round((depth + rng.normal(0.0, how.depth_noise_m, depth.shape)) / 0.001) * 0.001
    if how.missing:
        depth = np.where(rng.random(depth.shape) < how.missing, 0.0, depth)
    return RgbdFrame(np.clip(np.rint(rgb), 0, 255).astype(np.uint8), depth.astype(np.float32))


@lru_cache(maxsize=8)
def _rays(camera: PinholeCamera, samples: int) -> Array:
    """(3, rows, columns): world directions of unit depth through the pixels of a ``samples`` times finer image."""
    u = (np.arange(camera.width * samples) + 0.5) / samples - 0.5
    v = (np.arange(camera.height * samples) + 0.5) / samples - 0.5
    columns, rows = np.meshgrid((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy)
    rays = np.tensordot(camera.cam_to_world[:3, :3], np.stack([columns, rows, np.ones_like(rows)]), axes=1)
    if rays[2].max() >= 0:
        raise PerceptionError("the camera sees the horizon; all of its picture must show the table's plane")
    rays.setflags(write=False)
    return rays


def _meet(camera: PinholeCamera, level: Array | float, samples: int) -> tuple[Array, Array, Array]:
    """x, y and depth where the rays meet height ``level``."""
    rays = _rays(camera, samples)
    depth = (level - camera.position[2]) / rays[2]
    return camera.position[0] + depth * rays[0], camera.position[1] + depth * rays[1], depth


def _pooled(camera: PinholeCamera, values: Array, samples: int) -> Array:
    """Mean over the rays of each pixel."""
    return values.reshape(camera.height, samples, camera.width, samples, *values.shape[2:]).mean(axis=(1, 3))
