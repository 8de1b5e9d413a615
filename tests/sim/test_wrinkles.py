"""The judge of wrinkles against fine analytic height fields, and the wrinkles that can be made."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from layflat.sim.cloth.registry import cloth_spec
from layflat.tests.sim.wrinkles import (
    CENTRE_M,
    MIN_ENERGY,
    Wrinkling,
    axis_error,
    settled_wrinkles,
    wrinkle_truth,
    wrinkled_nodes,
)

SPEC = cloth_spec("towel")
CELL_M = SPEC.length_m / (SPEC.rows - 1)
DEEP = Wrinkling(normal_rad=0.0, wavelength_m=0.08, amplitude_m=0.009, phase_rad=1.0)
Wave = tuple[float, float, float, float]
"""Angle of the normal rad, wavelength m, amplitude m, phase rad."""
WAVES = st.tuples(
    st.floats(-math.pi / 2, math.pi / 2), st.floats(4 * CELL_M, 7 * CELL_M), st.floats(0.002, 0.006), st.floats(0, 6.3)
)


def height(x: np.ndarray, y: np.ndarray, waves: list[Wave]) -> np.ndarray:
    return 0.004 + sum(
        a * (1 + np.sin(2 * math.pi * (x * math.cos(n) + y * math.sin(n)) / length + phase))
        for n, length, a, phase in waves
    )


def wavy(*waves: Wave) -> np.ndarray:
    nodes = SPEC.flat_nodes()
    nodes[:, 2] = height(nodes[:, 0], nodes[:, 1], list(waves))
    return nodes


@settings(max_examples=40, deadline=None)
@given(waves=st.lists(WAVES, min_size=1, max_size=3))
def test_mixtures_agree_with_the_gradient_of_a_fine_height_field(waves: list[Wave]) -> None:
    """numpy.gradient on a grid of 0.9 mm, and the eigenvalues of the tensor: another road to the same numbers."""
    x = np.linspace(0.0, SPEC.length_m, 401)
    y = np.linspace(-SPEC.width_m / 2, SPEC.width_m / 2, 401)
    z = height(*np.meshgrid(x, y, indexing="ij"), waves)
    slope = np.stack(np.gradient(z, x, y), axis=-1).reshape(-1, 2)
    tensor = slope.T @ slope / len(slope)
    values, vectors = np.linalg.eigh(tensor)
    coherence = (values[1] - values[0]) / values.sum()
    truth = wrinkle_truth(wavy(*waves), SPEC)
    assert truth.energy == pytest.approx(np.trace(tensor), rel=0.08)
    if truth.energy > 2 * MIN_ENERGY:
        assert truth.coherence == pytest.approx(coherence, abs=0.06)
        if coherence > 0.3:
            assert axis_error(truth.direction, math.atan2(vectors[1, 1], vectors[0, 1])) < 3.0


@pytest.mark.parametrize("amplitude_m", [0.002, 0.009, 0.015])
def test_lengths_along_and_across_the_wrinkles_are_kept(amplitude_m: float) -> None:
    """Measured on a mesh of 1.75 mm, whose edges are nearly as long as the curve between their ends."""
    fine = replace(SPEC, rows=201)
    grid = wrinkled_nodes(fine, replace(DEEP, amplitude_m=amplitude_m)).reshape(201, SPEC.columns, 3)
    lengths = np.linalg.norm(np.diff(grid, axis=0), axis=2)
    np.testing.assert_allclose(lengths, SPEC.length_m / 200, rtol=0.01)
    np.testing.assert_allclose(lengths.sum(axis=0), SPEC.length_m, rtol=2e-3)
    np.testing.assert_allclose(np.linalg.norm(grid[:, 0] - grid[:, -1], axis=1), SPEC.width_m)
    low, high = grid[..., 2].min(), grid[..., 2].max()
    assert (low, high) == pytest.approx((SPEC.margin_m, SPEC.margin_m + 2 * amplitude_m), abs=1e-4)


@pytest.mark.parametrize("name", ["towel", "napkin", "towel-fine"])
def test_every_direction_can_be_made(name: str) -> None:
    spec, rng = cloth_spec(name), np.random.default_rng(3)
    for normal in np.linspace(-math.pi / 2, math.pi / 2, 24, endpoint=False):
        wrinkling = Wrinkling.random(rng, spec, normal)
        nodes = wrinkled_nodes(spec, wrinkling)
        truth = wrinkle_truth(nodes, spec)
        assert axis_error(truth.direction, normal) < 2.5
        assert truth.direction[0] >= 0
        assert np.linalg.norm(truth.direction) == pytest.approx(1.0)
        assert truth.coherence > 0.95
        np.testing.assert_allclose(nodes[:, :2].mean(axis=0), CENTRE_M, atol=0.02)
    np.testing.assert_array_equal(settled_wrinkles(spec, wrinkling), settled_wrinkles(spec, wrinkling))


def test_wrinkles_stay_where_the_table_holds_them_and_spread_where_it_does_not() -> None:
    start = wrinkle_truth(wrinkled_nodes(SPEC, DEEP), SPEC)
    held, slippery = (wrinkle_truth(settled_wrinkles(SPEC, DEEP, table_friction=f), SPEC) for f in (1.0, 0.0))
    assert held.coherence > 0.9
    assert axis_error(held.direction, 0.0) < 5.0
    assert held.energy > 0.3 * start.energy
    assert start.energy - slippery.energy > 2 * (start.energy - held.energy)
