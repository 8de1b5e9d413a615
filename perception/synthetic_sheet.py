"""Wrinkled sheet on a table, rendered analytically: frames whose wrinkles, contact and light are known exactly.

Ray-cast with Lambert shading from one distant light and an ambient part, without a simulator. A descriptor's result can
be compared with the numbers that the frame was made from.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from layflat.perception.arrays import BoolArray, Float32Array, Float64Array, RgbArray
from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.errors import PerceptionError

Color: TypeAlias = tuple[float, float, float]

TABLE_RGB: Color = (205.0, 205.0, 200.0)
CLOTH_RGB: Color = (40.0, 90.0, 200.0)
SLOPE_STEP_M = 1e-5
"""Step of the finite differences that give the slopes."""
MAX_SLOPE = 0.9
"""The rays' fixed-point iteration converges where the surface is less steep than this against them."""
SHADOW_SAMPLES = 24


@dataclass(frozen=True, kw_only=True)
class Wave:
    """Sine wrinkles: height rises from 0 to 2 amplitude_m and back within one wavelength_m."""

    normal: float = 0.0
    """Angle of the wrinkles' perpendicular from +x, rad."""
    wavelength_m: float = 0.058
    amplitude_m: float = 0.002
    phase: float = 0.7
    """Phase, rad."""

    def __post_init__(self) -> None:
        if not (self.wavelength_m > 0 and self.amplitude_m >= 0):
            raise PerceptionError(f"{self}: the wavelength must be positive and the amplitude not negative")
        if self.slope > MAX_SLOPE:
            steep = f"is as steep as {self.slope:.2f}; at most {MAX_SLOPE} can be drawn"
            raise PerceptionError(f"{self} {steep}: use a longer wavelength")

    @property
    def slope(self) -> float:
        """Greatest slope, m/m."""
        return 2 * math.pi * self.amplitude_m / self.wavelength_m

    def height(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return the height above the trough, m, at table points (x, y), m."""
        along = x * math.cos(self.normal) + y * math.sin(self.normal)
        return self.amplitude_m * (1 + np.sin(2 * math.pi * along / self.wavelength_m + self.phase))


@dataclass(frozen=True, kw_only=True)
class SyntheticSheet:
    """Rectangular sheet; lengths in metres, angles in rad, table coordinates."""

    centre: tuple[float, float] = (0.25, 0.0)
    size: tuple[float, float] = (0.35, 0.35)
    yaw: float = 0.0
    rest_m: float = 0.004
    """Height of the wrinkles' troughs."""
    waves: tuple[Wave, ...] = ()
    """Wrinkles, whose heights add up; none for a flat sheet."""
    lift_x_m: float = math.inf
    """From here on towards +x the sheet rises ..."""
    lift_slope: float = 0.5
    """... by this much per metre."""
    rgb: Color = CLOTH_RGB

    @property
    def is_level(self) -> bool:
        """Whether the height is the same everywhere."""
        return not any(wave.amplitude_m for wave in self.waves) and self.lift_x_m == math.inf

    def height(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return the height above the table, m."""
        height = self.rest_m + self.lift_slope * np.clip(x - self.lift_x_m, 0.0, None)
        for wave in self.waves:
            height = height + wave.height(x, y)
        return height

    def slopes(self, x: Float64Array, y: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return dh/dx and dh/dy."""
        step = SLOPE_STEP_M
        along = self.height(x + step, y) - self.height(x - step, y)
        across = self.height(x, y + step) - self.height(x, y - step)
        return along / (2 * step), across / (2 * step)

    def covers(self, x: Float64Array, y: Float64Array) -> BoolArray:
        """Return where the sheet is, seen from straight above."""
        dx, dy = x - self.centre[0], y - self.centre[1]
        along = dx * math.cos(self.yaw) + dy * math.sin(self.yaw)
        across = -dx * math.sin(self.yaw) + dy * math.cos(self.yaw)
        return (np.abs(along) <= self.size[0] / 2) & (np.abs(across) <= self.size[1] / 2)


@dataclass(frozen=True, kw_only=True)
class Light:
    """Distant lamp, ambient light, and the camera's exposure."""

    azimuth_deg: float = 45.0
    """Direction on the table towards the lamp, from +x."""
    elevation_deg: float = 45.0
    """Height of the lamp; 90 is straight above."""
    ambient: float = 0.4
    """Share of the light that comes from everywhere, 0..1."""
    exposure: float = 1.0
    """Factor on all brightness; values above 255 are clipped, as in a camera."""
    tint: Color = (1.0, 1.0, 1.0)
    """Factor on each channel: a coloured lamp, or a white balance that has drifted."""
    shaded_from_m: float = math.inf
    """Beyond this y something blocks the lamp and only the ambient part is left (a soft edge of 10 mm)."""

    def __post_init__(self) -> None:
        if not (0 < self.elevation_deg <= 90 and 0 <= self.ambient <= 1 and self.exposure > 0):
            raise PerceptionError(f"{self}: elevation must lie in (0, 90] degrees, ambient in 0..1, exposure above 0")

    @property
    def towards(self) -> Float64Array:
        """(3,) unit vector to the lamp, world."""
        azimuth, elevation = math.radians(self.azimuth_deg), math.radians(self.elevation_deg)
        level = math.cos(elevation)
        return np.array([level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation)])

    def unblocked(self, y: Float64Array) -> Float64Array:
        """Return the share of the lamp's light that arrives at ``y``."""
        return np.clip((self.shaded_from_m - y) / 0.010 + 0.5, 0.0, 1.0)


@dataclass(frozen=True)
class RgbdFrame:
    """Colour image and depth of one camera."""

    rgb: RgbArray
    depth: Float32Array
    """(H, W) m along the optical axis; 0 where missing."""


@dataclass(frozen=True, kw_only=True)
class RenderConfig:
    """Light, sensor noise and sampling of ``render_sheet``."""

    light: Light = field(default_factory=Light)
    table_rgb: Color = TABLE_RGB
    rgb_noise: float = 0.0
    """Standard deviation, grey levels."""
    depth_noise_m: float = 0.0
    """Standard deviation; if not 0, depth is also rounded to whole millimetres."""
    missing: float = 0.0
    """Share of the depth pixels without a value."""
    seed: int = 0
    """Seed of the noise."""
    samples: int = 2
    """Rays per pixel along each axis."""

    def with_sensor_noise(self, seed: int) -> RenderConfig:
        """Return the same with the noise of a small colour camera and of a D435 at 1 m."""
        return replace(self, rgb_noise=3.0, depth_noise_m=0.0025, missing=0.02, seed=seed)


def render_sheet(camera: PinholeCamera, sheet: SyntheticSheet | None, config: RenderConfig | None = None) -> RgbdFrame:
    """Render a sheet on its table; None renders the table alone."""
    config = RenderConfig() if config is None else config
    light, samples = config.light, config.samples
    x, y, depth = _intersect(camera, 0.0, samples)
    brightness = np.full(x.shape, light.ambient) + (1 - light.ambient) * light.unblocked(y)
    albedo = np.broadcast_to(np.array(config.table_rgb), (*x.shape, 3))
    if sheet is not None:
        xs, ys, sheet_depth = x, y, depth
        for _ in range(1 if sheet.is_level else 8):
            xs, ys, sheet_depth = _intersect(camera, sheet.height(xs, ys), samples)
        cloth = sheet.covers(xs, ys)
        depth = np.where(cloth, sheet_depth, depth)
        brightness = np.where(cloth, _shade(sheet, light, xs, ys), brightness)
        albedo = np.where(cloth[..., None], sheet.rgb, albedo)
    color = albedo * (brightness[..., None] * light.exposure * np.array(light.tint))
    return _add_noise(_pool(camera, color, samples), _pool(camera, depth, samples), config)


def _shade(sheet: SyntheticSheet, light: Light, x: Float64Array, y: Float64Array) -> Float64Array:
    """Return the brightness of points of the sheet: 1 if it faces the lamp, ambient if in shadow."""
    lamp = light.towards
    gx, gy = sheet.slopes(x, y)
    facing = (lamp[2] - gx * lamp[0] - gy * lamp[1]) / np.sqrt(1 + gx**2 + gy**2)
    lit = np.clip(facing, 0.0, None) * light.unblocked(y) * ~_self_shadow(sheet, light, x, y)
    return light.ambient + (1 - light.ambient) * lit


def _self_shadow(sheet: SyntheticSheet, light: Light, x: Float64Array, y: Float64Array) -> BoolArray:
    """Return where a crest is between the sheet and the lamp."""
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


def _add_noise(rgb: Float64Array, depth: Float64Array, config: RenderConfig) -> RgbdFrame:
    rng = np.random.default_rng(config.seed)
    if config.rgb_noise:
        rgb = rgb + rng.normal(0.0, config.rgb_noise, rgb.shape)
    if config.depth_noise_m:
        depth = np.round((depth + rng.normal(0.0, config.depth_noise_m, depth.shape)) / 0.001) * 0.001
    if config.missing:
        depth = np.where(rng.random(depth.shape) < config.missing, 0.0, depth)
    return RgbdFrame(np.clip(np.rint(rgb), 0, 255).astype(np.uint8), depth.astype(np.float32))


@lru_cache(maxsize=8)
def _rays(camera: PinholeCamera, samples: int) -> Float64Array:
    """Return (3, rows, columns) world rays of unit depth through the pixels of a ``samples`` times finer image."""
    u = (np.arange(camera.width * samples) + 0.5) / samples - 0.5
    v = (np.arange(camera.height * samples) + 0.5) / samples - 0.5
    columns, rows = np.meshgrid((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy)
    rays = np.tensordot(camera.cam_to_world[:3, :3], np.stack([columns, rows, np.ones_like(rows)]), axes=1)
    if rays[2].max() >= 0:
        raise PerceptionError("the camera sees the horizon; all of its image must show the table's plane")
    rays.setflags(write=False)
    return rays


def _intersect(
    camera: PinholeCamera, height: Float64Array | float, samples: int
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return x, y and depth where the rays reach ``height``."""
    rays = _rays(camera, samples)
    depth = (height - camera.position[2]) / rays[2]
    return camera.position[0] + depth * rays[0], camera.position[1] + depth * rays[1], depth


def _pool(camera: PinholeCamera, values: Float64Array, samples: int) -> Float64Array:
    """Average over the rays of each pixel."""
    return values.reshape(camera.height, samples, camera.width, samples, *values.shape[2:]).mean(axis=(1, 3))
