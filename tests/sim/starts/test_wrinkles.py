"""Cloth put into wrinkles of one direction, and what the physics leaves of them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from layflat.sim.cloth.spec import cloth_spec
from layflat.sim.cloth.wrinkle_ground_truth import wrinkle_truth
from layflat.sim.errors import SimError
from layflat.sim.starts.wrinkles import CENTRE_M, Wrinkling, settled_wrinkles, wrinkled_nodes

SPEC = cloth_spec("towel")
DEEP = Wrinkling(normal_rad=0.0, wavelength_m=0.08, amplitude_m=0.009, phase_rad=1.0)


def axis_error(one: np.ndarray, angle: float) -> float:
    apart = math.degrees(math.atan2(one[1], one[0]) - angle) % 180
    return min(apart, 180 - apart)


@pytest.mark.parametrize("amplitude_m", [0.002, 0.009, 0.015])
def test_lengths_along_and_across_the_wrinkles_are_kept(amplitude_m: float) -> None:
    """Measured on a mesh of 1.75 mm, whose edges are nearly as long as the curve between their ends."""
    fine = replace(SPEC, rows=201)
    grid = wrinkled_nodes(fine, replace(DEEP, amplitude_m=amplitude_m)).reshape(201, SPEC.columns, 3)
    lengths = np.linalg.norm(np.diff(grid, axis=0), axis=2)
    np.testing.assert_allclose(lengths, SPEC.length_m / 200, rtol=0.01)
    np.testing.assert_allclose(lengths.sum(axis=0), SPEC.length_m, rtol=2e-3)
    np.testing.assert_allclose(np.linalg.norm(grid[:, 0] - grid[:, -1], axis=1), SPEC.width_m)
    assert np.ptp(grid[..., 0]) < SPEC.length_m
    assert grid[..., 2].min() == pytest.approx(SPEC.margin_m, abs=1e-4)
    assert grid[..., 2].max() == pytest.approx(SPEC.margin_m + 2 * amplitude_m, abs=1e-4)


@pytest.mark.parametrize("name", ["towel", "napkin", "towel-fine"])
def test_every_direction_can_be_made(name: str) -> None:
    spec, rng = cloth_spec(name), np.random.default_rng(3)
    for normal in np.linspace(-math.pi / 2, math.pi / 2, 24, endpoint=False):
        nodes = wrinkled_nodes(spec, Wrinkling.random(rng, spec, normal))
        truth = wrinkle_truth(nodes, spec)
        assert axis_error(truth.direction, normal) < 2.5
        assert truth.coherence > 0.95
        np.testing.assert_allclose(nodes[:, :2].mean(axis=0), CENTRE_M, atol=0.02)


def test_wrinkles_stay_where_the_table_holds_them_and_spread_where_it_does_not() -> None:
    start = wrinkle_truth(wrinkled_nodes(SPEC, DEEP), SPEC)
    held, slippery = (wrinkle_truth(settled_wrinkles(SPEC, DEEP, table_friction=f), SPEC) for f in (1.0, 0.0))
    assert held.coherence > 0.9
    assert axis_error(held.direction, 0.0) < 5.0
    assert held.energy > 0.3 * start.energy
    assert held.contact_portion > start.contact_portion
    assert start.energy - slippery.energy > 2 * (start.energy - held.energy)


def test_the_same_wrinkling_gives_the_same_nodes() -> None:
    one, other = (Wrinkling.random(np.random.default_rng(7), SPEC, 0.5) for _ in range(2))
    assert one == other
    np.testing.assert_array_equal(settled_wrinkles(SPEC, one), settled_wrinkles(SPEC, other))


def test_impossible_wrinkles_are_refused() -> None:
    with pytest.raises(SimError, match=r"the amplitude must be between 0 and a quarter of the wavelength"):
        Wrinkling(normal_rad=0.0, wavelength_m=0.02, amplitude_m=0.01)
