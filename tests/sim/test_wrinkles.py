"""The judge of wrinkles against fine analytic height fields, and what it has to ignore."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from layflat.sim.cloth.spec import cloth_spec
from layflat.tests.sim.wrinkles import (
    CENTRE_M,
    MAX_SLOPE,
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
    assume(z.max() < 0.028 and np.linalg.norm(slope, axis=1).max() < MAX_SLOPE)
    tensor = slope.T @ slope / len(slope)
    values, vectors = np.linalg.eigh(tensor)
    coherence = (values[1] - values[0]) / values.sum()
    truth = wrinkle_truth(wavy(*waves), SPEC)
    assert truth.energy == pytest.approx(np.trace(tensor), rel=0.08)
    if truth.energy > 2 * MIN_ENERGY:
        assert truth.coherence == pytest.approx(coherence, abs=0.06)
        if coherence > 0.3:
            assert axis_error(truth.direction, math.atan2(vectors[1, 1], vectors[0, 1])) < 3.0


@given(wave=WAVES, angle=st.floats(-math.pi, math.pi), x_m=st.floats(-0.3, 0.5), y_m=st.floats(-0.3, 0.3))
def test_it_turns_with_the_cloth_wherever_it_lies(wave: Wave, angle: float, x_m: float, y_m: float) -> None:
    nodes, (c, s) = wavy(wave), (math.cos(angle), math.sin(angle))
    turned = nodes @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + [x_m, y_m, 0.0]
    one, other = wrinkle_truth(nodes, SPEC), wrinkle_truth(turned, SPEC)
    assert (other.energy, other.coherence) == pytest.approx((one.energy, one.coherence))
    if one.coherence > 0:
        assert axis_error(other.direction, math.atan2(one.direction[1], one.direction[0]) + angle) < 1e-6


def test_flat_and_lifted_cloths_have_no_direction() -> None:
    flat = SPEC.flat_nodes() + np.random.default_rng(0).normal(0, [0, 0, 0.0002], (SPEC.n_nodes, 3))
    lifted = wavy((0.3, 0.1, 0.006, 0.0)) + np.array([0.0, 0.0, 0.2])
    hanging = SPEC.hanging_nodes(np.array([[0, 0.17, 0.5], [0, -0.17, 0.5]]))
    for nodes, share in ((flat, 1.0), (lifted, 0.0), (hanging, 0.0)):
        truth = wrinkle_truth(nodes, SPEC)
        assert not truth.direction.any()
        assert truth.coherence == 0.0
        assert truth.share == pytest.approx(share, abs=0.01)
        assert (0 < truth.energy < MIN_ENERGY) if share else (truth.energy == truth.contact_portion == 0.0)


def test_what_is_folded_over_does_not_count() -> None:
    """Half of the cloth has wrinkles along y and lies face down on the other half, whose wrinkles are along x."""
    nodes, over = wavy((math.pi / 2, 0.1, 0.004, 0.0)), SPEC.flat_nodes()[:, 0] > SPEC.length_m / 2
    nodes[over] = wavy((0.0, 0.1, 0.004, 0.0))[over]
    nodes[over, 0] = SPEC.length_m - nodes[over, 0]
    nodes[over, 2] += 0.012
    truth = wrinkle_truth(nodes, SPEC)
    assert axis_error(truth.direction, math.pi / 2) < 5.0
    assert truth.share == pytest.approx(0.5, abs=0.08)


def test_one_upright_crease_does_not_outweigh_the_rest() -> None:
    grid = wavy((0.0, 0.09, 0.004, 0.0)).reshape(SPEC.rows, SPEC.columns, 3)
    grid[:, SPEC.columns // 2 :, 1] += CELL_M * 0.97  # the next column stands almost below this one ...
    grid[:, SPEC.columns // 2 :, 2] += 0.012  # ... and 12 mm higher
    truth = wrinkle_truth(grid.reshape(-1, 3), SPEC)
    assert axis_error(truth.direction, 0.0) < 5.0
    assert truth.energy < MAX_SLOPE**2


@pytest.mark.parametrize("rise", [math.pi / 4, math.pi / 2])
def test_what_is_lifted_and_its_foot_do_not_turn_what_lies(rise: float) -> None:
    """From x = 0.2 m on the cloth goes up at ``rise``, its length kept: a slope along x that is no wrinkle."""
    nodes = wavy((0.9, 0.1, 0.005, 0.0))
    beyond = np.clip(nodes[:, 0] - 0.2, 0.0, None)
    nodes[:, 0] += (math.cos(rise) - 1) * beyond
    nodes[:, 2] += math.sin(rise) * beyond
    truth = wrinkle_truth(nodes, SPEC)
    assert axis_error(truth.direction, 0.9) < 5.0
    assert 0.3 < truth.share < 0.6


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
    assert held.contact_portion > start.contact_portion
    assert start.energy - slippery.energy > 2 * (start.energy - held.energy)
