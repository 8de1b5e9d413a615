"""Drawn frames of known sheets: what the perception tests look at."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.synthetic_sheet import Light, RenderConfig, RgbdFrame, SyntheticSheet, Wave, render_sheet


def one_wave(
    *,
    amplitude: float = 0.0,
    wavelength: float = 0.058,
    normal: float = 0.0,
    phase: float = 0.7,
    rest: float = 0.004,
    lift_x: float = math.inf,
    **sheet: object,
) -> SyntheticSheet:
    """A sheet with wrinkles in one direction, in the short words of the tests."""
    wave = Wave(amplitude_m=amplitude, wavelength_m=wavelength, normal=normal, phase=phase)
    return SyntheticSheet(waves=(wave,), rest_m=rest, lift_x_m=lift_x, **sheet)  # type: ignore[arg-type]


def draw(
    camera: PinholeCamera,
    sheet: SyntheticSheet | None,
    *,
    azimuth_deg: float = 45.0,
    elevation_deg: float = 45.0,
    exposure: float = 1.0,
    seed: int | None = None,
    missing: float = 0.0,
) -> RgbdFrame:
    """With a seed, sensor noise (3 grey levels, 2.5 mm) and missing depth."""
    light = Light(azimuth_deg=azimuth_deg, elevation_deg=elevation_deg, exposure=exposure)
    if seed is None:
        return render_sheet(camera, sheet, RenderConfig(light=light))
    noise = RenderConfig(light=light, rgb_noise=3.0, depth_noise_m=0.0025, missing=missing, seed=seed)
    return render_sheet(camera, sheet, noise)


@pytest.fixture(scope="session")
def tilted_camera() -> PinholeCamera:
    """Beside the table, about 51 degrees above the horizontal."""
    return PinholeCamera.look_at((0.25, -0.6, 0.75), (0.25, 0.0, 0.0), width=320, height=240, fx=307.0)


@pytest.fixture(scope="session")
def make_sheet() -> Callable[..., SyntheticSheet]:
    return one_wave


@pytest.fixture(scope="session", name="render_sheet")
def _draw_sheet() -> Callable[..., RgbdFrame]:
    return draw
