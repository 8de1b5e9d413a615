"""Drawn sheets are what their numbers say: geometry by back-projection, shading by Lambert's law."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from layflat.perception.synthetic_sheet import CLOTH_RGB, Light, RenderConfig, SyntheticSheet, Wave, render_sheet
from layflat.tests.perception.factories import TILTED

RIPPLED = SyntheticSheet(
    waves=(Wave(normal=0.6, amplitude_m=0.003), Wave(normal=-0.9, wavelength_m=0.09, amplitude_m=0.002))
)


def inside(sheet):
    """Pixels (N, 2) and world points (N, 3) well inside the sheet, of a drawing with one ray a pixel."""
    frame = render_sheet(TILTED, sheet, RenderConfig(samples=1))
    v, u = np.mgrid[0 : TILTED.height, 0 : TILTED.width]
    pixels = np.column_stack([u.ravel(), v.ravel()])
    points = TILTED.back_project(pixels, frame.depth.ravel())
    kept = replace(sheet, size=(0.28, 0.28)).covers(points[:, 0], points[:, 1])
    return pixels[kept], points[kept]


def test_depth_back_projects_onto_the_surface():
    _, points = inside(RIPPLED)
    assert len(points) > 5_000
    np.testing.assert_allclose(points[:, 2], RIPPLED.height(points[:, 0], points[:, 1]), atol=2e-5)


def test_heights_of_waves_add_up_and_the_trough_is_at_rest():
    x, y = np.random.default_rng(0).uniform(-0.2, 0.5, (2, 500))
    apart = sum(wave.height(x, y) for wave in RIPPLED.waves)
    np.testing.assert_allclose(RIPPLED.height(x, y), RIPPLED.rest_m + apart)
    assert 0 <= apart.min() < 0.0005
    assert RIPPLED.waves[0].height(x, y).max() == pytest.approx(2 * 0.003, rel=0.01)
    gx, gy = replace(RIPPLED, waves=RIPPLED.waves[:1]).slopes(x, y)
    np.testing.assert_allclose(gx * math.sin(0.6), gy * math.cos(0.6), atol=1e-9)  # along the wave's normal
    assert np.hypot(gx, gy).max() == pytest.approx(RIPPLED.waves[0].slope, rel=0.01)


@pytest.mark.parametrize(("azimuth", "elevation"), [(0.0, 45.0), (130.0, 60.0), (-70.0, 35.0)])
def test_brightness_is_lamberts_law(azimuth, elevation):
    light = Light(azimuth_deg=azimuth, elevation_deg=elevation, ambient=0.25, exposure=0.8)
    frame = render_sheet(TILTED, RIPPLED, RenderConfig(light=light, samples=1))
    pixels, points = inside(RIPPLED)
    gx, gy = RIPPLED.slopes(points[:, 0], points[:, 1])
    normals = np.column_stack([-gx, -gy, np.ones_like(gx)])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    wanted = 0.8 * (0.25 + 0.75 * np.clip(normals @ light.towards, 0, None))[:, None] * np.array(CLOTH_RGB)
    seen = frame.rgb[pixels[:, 1], pixels[:, 0]]
    np.testing.assert_allclose(seen, wanted, atol=1.0)


def test_a_low_lamp_throws_the_shadows_of_crests_and_a_high_one_none():
    steep = SyntheticSheet(waves=(Wave(normal=0.0, amplitude_m=0.003),))  # 18 degrees
    ambient_only = np.rint(0.4 * np.array(CLOTH_RGB))
    shares = {}
    for elevation in (10.0, 16.0, 40.0):
        frame = render_sheet(
            TILTED, steep, RenderConfig(light=Light(azimuth_deg=0.0, elevation_deg=elevation), samples=1)
        )
        pixels, _ = inside(steep)
        shares[elevation] = float((frame.rgb[pixels[:, 1], pixels[:, 0]] == ambient_only).all(axis=1).mean())
    assert shares[10.0] > shares[16.0] > 0.02
    assert shares[40.0] == 0.0


def test_what_stands_in_the_light_shades_one_side():
    frame = render_sheet(TILTED, SyntheticSheet(), RenderConfig(light=Light(elevation_deg=90.0, shaded_from_m=0.05)))
    (lit, shaded), _ = TILTED.project([(0.25, 0.0, 0.004), (0.25, 0.1, 0.004)])
    bright, dark = (frame.rgb[round(p[1]), round(p[0])].astype(float) for p in (lit, shaded))
    np.testing.assert_allclose(dark, 0.4 * bright, atol=1.0)


def test_exposure_cuts_off_and_tint_colours():
    light = Light(elevation_deg=90.0)
    plain = render_sheet(TILTED, SyntheticSheet(), RenderConfig(light=light)).rgb
    tinted = render_sheet(TILTED, SyntheticSheet(), RenderConfig(light=replace(light, tint=(0.5, 1.0, 1.0)))).rgb
    np.testing.assert_allclose(tinted[..., 0], plain[..., 0] / 2, atol=0.6)
    np.testing.assert_array_equal(tinted[..., 1:], plain[..., 1:])
    over = render_sheet(TILTED, SyntheticSheet(), RenderConfig(light=replace(light, exposure=3.0))).rgb
    assert over[..., 2].max() == 255
    assert over[120, 160, 0] == 120


def test_noise_has_its_size_and_its_seed():
    clean, noisy = (
        render_sheet(TILTED, SyntheticSheet()),
        render_sheet(TILTED, SyntheticSheet(), RenderConfig().with_sensor_noise(3)),
    )
    again, other = (render_sheet(TILTED, SyntheticSheet(), RenderConfig().with_sensor_noise(seed)) for seed in (3, 4))
    np.testing.assert_array_equal(noisy.rgb, again.rgb)
    np.testing.assert_array_equal(noisy.depth, again.depth)
    assert (noisy.rgb != other.rgb).any()
    missing = noisy.depth == 0
    assert missing.mean() == pytest.approx(0.02, rel=0.15)
    assert (noisy.depth - clean.depth)[~missing].std() == pytest.approx(0.0025, rel=0.05)
    assert (noisy.rgb.astype(float) - clean.rgb).std() == pytest.approx(3.0, rel=0.05)
