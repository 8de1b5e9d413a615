"""The depth sensor's error model."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.sim.camera.depth_noise import DepthNoise, DepthSensor
from layflat.sim.errors import SimError

SHAPE = (120, 160)
FINE = {"disparity_step_px": 1e-4, "missing_share": 0.0, "missing_at_edges": 0.0}


def _wall(depth_m: float) -> np.ndarray:
    return np.full(SHAPE, depth_m, np.float32)


@pytest.mark.parametrize("depth_m", [0.6, 1.2, 2.4])
def test_error_grows_with_the_square_of_depth(depth_m: float) -> None:
    measured = DepthSensor(DepthNoise(**FINE), seed=0).measure(_wall(depth_m))
    # sigma_z = z^2 * subpixel / (f B), written out.
    assert measured.std() == pytest.approx(depth_m**2 * 0.05 / (385.0 * 0.05), rel=0.05)
    assert measured.mean() == pytest.approx(depth_m, abs=0.002 * depth_m)


def test_depths_are_whole_steps_of_disparity() -> None:
    noise = DepthNoise()
    measured = DepthSensor(noise, seed=0).measure(_wall(1.0))
    steps = noise.focal_px * noise.baseline_m / measured[measured > 0] / noise.disparity_step_px
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-3)
    assert len(np.unique(np.rint(steps))) > 3


def test_share_of_missing_pixels_without_edges() -> None:
    sensor = DepthSensor(DepthNoise(missing_share=0.02), seed=0)
    missing = np.mean([(sensor.measure(_wall(1.0)) == 0).mean() for _ in range(20)])
    assert missing == pytest.approx(0.02, rel=0.2)


def test_many_pixels_are_missing_along_a_depth_edge_only() -> None:
    wall = _wall(1.0)
    wall[:, 80:] = 1.2
    sensor = DepthSensor(DepthNoise(), seed=0)
    missing = np.mean([sensor.measure(wall) == 0 for _ in range(20)], axis=0)
    assert 0.4 < missing[:, 79:81].mean() < 0.6
    assert missing[:, :75].mean() < 0.02


def test_neighbours_share_their_error() -> None:
    error = DepthSensor(DepthNoise(**FINE), seed=0).measure(_wall(1.0)) - 1.0
    beside = np.corrcoef(error[:, :-1].ravel(), error[:, 1:].ravel())[0, 1]
    apart = np.corrcoef(error[:, :-12].ravel(), error[:, 12:].ravel())[0, 1]
    assert beside > 0.4
    assert abs(apart) < 0.1


def test_no_value_out_of_range_or_where_there_was_none() -> None:
    wall = _wall(1.0)
    wall[:40], wall[40:60], wall[60:70] = 0.0, 0.1, 9.0
    measured = DepthSensor(DepthNoise(), seed=0).measure(wall)
    assert not measured[:70].any()
    assert np.isfinite(measured).all()
    assert measured.dtype == np.float32


def test_same_seed_same_bits() -> None:
    first, second, other = (DepthSensor(DepthNoise(), seed=s) for s in (5, 5, 6))
    for _ in range(3):
        a, b, c = first.measure(_wall(1.0)), second.measure(_wall(1.0)), other.measure(_wall(1.0))
        assert a.tobytes() == b.tobytes()
        assert a.tobytes() != c.tobytes()


@pytest.mark.parametrize("wrong", [{"focal_px": 0.0}, {"missing_share": 1.0}, {"range_m": (2.0, 1.0)}])
def test_nonsense_is_refused(wrong: dict) -> None:
    with pytest.raises(SimError, match=next(iter(wrong))):
        DepthNoise(**wrong)
