"""Cameras, rendered sheets and striped views that the perception tests share."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np

from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.camera.rectified_view import ClothView
from layflat.perception.synthetic_sheet import Light, RenderConfig, RgbdFrame, SyntheticSheet, Wave, render_sheet

CLOTH_RGB = (40.0, 90.0, 200.0)
TILTED = PinholeCamera.look_at((0.25, -0.6, 0.75), (0.25, 0.0, 0.0), width=320, height=240, fx=307.0)
"""A camera beside the table, about 51 degrees above the horizontal."""


def axis_error(vector, normal: float | np.ndarray) -> float:
    """Return the degrees between two axes, 0..90; ``normal`` is an angle, rad, or a vector."""
    if not np.isscalar(normal):
        normal = math.atan2(normal[1], normal[0])
    angle = math.degrees(math.atan2(vector[1], vector[0]) - normal) % 180
    return min(angle, 180 - angle)


def wrinkled_sheet(*, amplitude=0.0, normal=0.0, rest=0.004, lift_x=math.inf, **sheet) -> SyntheticSheet:
    """Return a sheet with wrinkles in one direction."""
    return SyntheticSheet(waves=(Wave(amplitude_m=amplitude, normal=normal),), rest_m=rest, lift_x_m=lift_x, **sheet)


def render(sheet: SyntheticSheet | None, camera=TILTED, *, seed: int | None = None, missing=0.0, **light) -> RgbdFrame:
    """Render a sheet; with a seed, with sensor noise (3 grey levels, 2.5 mm) and missing depth."""
    config = RenderConfig(light=Light(**light))
    if seed is not None:
        config = replace(config.with_sensor_noise(seed), missing=missing)
    return render_sheet(camera, sheet, config)


def striped_view(
    normal: float = 0.4,
    *,
    depth: float = 0.1,
    slope: float = 0.0,
    wavelength_mm: float = 58.0,
    noise: float = 0.0,
    exposure: float = 1.0,
    rest_m: float = 0.004,
    shape: tuple[int, int] = (140, 140),
) -> ClothView:
    """Return a cloth on a white table with sine stripes whose perpendicular is at ``normal`` rad from +x (y up).

    ``depth`` is their amplitude in relative brightness, ``slope`` that of the relief. All of the cloth is in contact.
    """
    rows, columns = (side + 20 for side in shape)
    row, column = np.mgrid[:rows, :columns]
    along = 2 * math.pi * (column * math.cos(normal) - row * math.sin(normal)) * 2.5 / wavelength_mm + 0.4
    cloth = np.zeros((rows, columns), dtype=bool)
    cloth[10:-10, 10:-10] = True
    rgb = np.where(cloth[..., None], np.array(CLOTH_RGB) * (1 + depth * np.sin(along))[..., None], 205.0)
    rgb = exposure * rgb + np.random.default_rng(1).normal(0, noise, rgb.shape)
    height = rest_m + slope * wavelength_mm / 1000 / (2 * math.pi) * (1 - np.cos(along))
    return ClothView(
        rgb=np.clip(np.rint(rgb), 0, 255).astype(np.uint8),
        cloth=cloth,
        contact=cloth.copy(),
        height=np.where(cloth, height, 0.06).astype(np.float32),
        mm_per_px=2.5,
    )


def finer(view: ClothView) -> ClothView:
    """Return the same cloth with twice the pixels along each axis."""
    size = (2 * view.cloth.shape[1], 2 * view.cloth.shape[0])
    masks = {name: getattr(view, name).repeat(2, 0).repeat(2, 1) for name in ("cloth", "contact")}
    rgb = cv2.resize(view.rgb, size, interpolation=cv2.INTER_CUBIC)
    return ClothView(rgb=rgb, height=cv2.resize(view.height, size), mm_per_px=view.mm_per_px / 2, **masks)
