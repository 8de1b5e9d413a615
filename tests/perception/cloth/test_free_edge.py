"""The lowest part of a cloth, against one whose place is known."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.perception.camera.pinhole import PinholeCamera
from layflat.perception.cloth.contact import MIN_PIXELS, free_edge

CAMERA = PinholeCamera.look_at((0.15, -0.72, 0.86), (0.285, 0.065, 0.0), width=320, height=240, fx=307.5)

PIXEL_M = 0.005
"""What a pixel's rounding moves a height by: 1 m of distance, seen at a slant."""


def hanging(x_m: float, low_m: float, rng: np.random.Generator, noise_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Mask and depth of a sheet, 0.3 m wide and high, that hangs in the plane x = ``x_m`` + 0.2 (z - ``low_m``)."""
    along, across = np.meshgrid(np.linspace(0.0, 0.3, 900), np.linspace(-0.15, 0.15, 900))
    points = np.stack([x_m + 0.2 * along, across, low_m + along], axis=-1).reshape(-1, 3)
    pixels, depth = CAMERA.project(points)
    u, v = np.rint(pixels).astype(int).T
    seen = (u >= 0) & (u < 320) & (v >= 0) & (v < 240)
    mask, image = np.zeros((240, 320), dtype=bool), np.zeros((240, 320), dtype=np.float32)
    mask[v[seen], u[seen]] = True
    image[v[seen], u[seen]] = depth[seen]
    return mask, np.where(mask, image + rng.normal(0.0, noise_m, image.shape), 0.0).astype(np.float32)


@pytest.mark.parametrize("low_m", [0.01, 0.1])
@pytest.mark.parametrize("x_m", [-0.05, 0.1, 0.3])
def test_the_free_edge_is_found(x_m, low_m):
    rng = np.random.default_rng(1)
    exact = free_edge(CAMERA, *hanging(x_m, low_m, rng, 0.0))
    noisy = free_edge(CAMERA, *hanging(x_m, low_m, rng, 0.003))
    assert exact is not None
    assert noisy is not None
    # Of 0.3 m a twentieth is 15 mm.
    assert low_m - PIXEL_M < exact[2] < low_m + 0.015 + PIXEL_M
    assert exact[0] == pytest.approx(x_m, abs=PIXEL_M)
    assert exact[1] == pytest.approx(0.0, abs=0.15)
    np.testing.assert_allclose(noisy[[0, 2]], exact[[0, 2]], atol=0.008)


def test_where_the_sensor_is_blind_or_sees_next_to_nothing_there_is_none():
    mask, depth = hanging(0.1, 0.05, np.random.default_rng(0), 0.0)
    assert free_edge(CAMERA, mask, np.zeros_like(depth)) is None
    rows, columns = np.nonzero(mask)
    few = np.zeros_like(mask)
    few[rows[: MIN_PIXELS - 1], columns[: MIN_PIXELS - 1]] = True
    assert free_edge(CAMERA, few, depth) is None
