"""The mesh's wrinkle truth against fine analytic height fields, and what may not change it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from layflat.sim.cloth.geometry import ClothGeometry
from layflat.sim.cloth.spec import cloth_spec
from layflat.sim.cloth.wrinkle_ground_truth import MAX_SLOPE, MIN_ENERGY, WrinkleTruth, wrinkle_truth
from layflat.sim.errors import SimError

SPEC = cloth_spec("towel")
CELL_M = SPEC.length_m / (SPEC.rows - 1)
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


def axis_error(one: np.ndarray, angle: float) -> float:
    """Degrees between two axes, 0..90."""
    apart = math.degrees(math.atan2(one[1], one[0]) - angle) % 180
    return min(apart, 180 - apart)


def turned(nodes: np.ndarray, angle: float, x_m: float = 0.0, y_m: float = 0.0) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return nodes @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + [x_m, y_m, 0.0]


def assert_none(truth: WrinkleTruth) -> None:
    np.testing.assert_array_equal(truth.direction, np.zeros(2))
    assert truth.coherence == 0.0


@pytest.mark.parametrize("cells", [3.0, 4.0, 6.0])
def test_one_wave_has_its_direction_at_all_angles(cells: float) -> None:
    for normal in np.linspace(-math.pi / 2, math.pi / 2, 24, endpoint=False):
        truth = wrinkle_truth(wavy((normal, cells * CELL_M, 0.005, 0.7)), SPEC)
        assert axis_error(truth.direction, normal) < 1.0
        assert truth.direction[0] >= 0
        assert np.linalg.norm(truth.direction) == pytest.approx(1.0)
        assert truth.coherence > 0.95


@pytest.mark.parametrize("normal", [math.pi / 2 - 0.01, math.pi / 2, -math.pi / 2, -math.pi / 2 + 0.01])
def test_the_axis_goes_through_plus_minus_90_degrees_without_a_jump(normal: float) -> None:
    truth = wrinkle_truth(wavy((normal, 0.1, 0.005, 0.0)), SPEC)
    assert axis_error(truth.direction, math.pi / 2) < 1.0
    assert 0 <= truth.direction[0] < 0.02


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


@given(
    wave=WAVES,
    angle=st.floats(-math.pi, math.pi),
    x_m=st.floats(-0.3, 0.5),
    y_m=st.floats(-0.3, 0.3),
)
def test_it_turns_with_the_cloth_and_does_not_care_where_it_lies(
    wave: Wave, angle: float, x_m: float, y_m: float
) -> None:
    nodes = wavy(wave)
    one, other = wrinkle_truth(nodes, SPEC), wrinkle_truth(turned(nodes, angle, x_m, y_m), SPEC)
    assert other.energy == pytest.approx(one.energy)
    assert other.coherence == pytest.approx(one.coherence)
    if one.coherence > 0:
        assert axis_error(other.direction, math.atan2(one.direction[1], one.direction[0]) + angle) < 1e-6


@given(wave=WAVES, other=WAVES)
def test_a_mirrored_cloth_has_a_mirrored_direction(wave: Wave, other: Wave) -> None:
    nodes = wavy(wave, other)
    # Columns in the opposite order: a mirrored grid would lie on its face.
    mirrored = (nodes * [1.0, -1.0, 1.0]).reshape(SPEC.rows, SPEC.columns, 3)[:, ::-1].reshape(-1, 3)
    one, two = wrinkle_truth(nodes, SPEC), wrinkle_truth(mirrored, SPEC)
    assert two.energy == pytest.approx(one.energy)
    assert two.coherence == pytest.approx(one.coherence)
    if one.coherence > 1e-6:
        np.testing.assert_allclose(abs(two.direction), abs(one.direction), atol=1e-9)
        assert axis_error(two.direction, -math.atan2(one.direction[1], one.direction[0])) < 1e-5


def test_energy_grows_with_the_square_of_the_amplitude() -> None:
    small, large = (wrinkle_truth(wavy((0.3, 0.12, a, 0.0)), SPEC).energy for a in (0.003, 0.006))
    assert large == pytest.approx(4 * small)
    assert small == pytest.approx((2 * math.pi * 0.003 / 0.12) ** 2 / 2, rel=0.1)  # of a sine, over whole periods


def test_flat_and_lifted_cloths_have_no_direction() -> None:
    rng = np.random.default_rng(0)
    flat = SPEC.flat_nodes() + rng.normal(0, [0, 0, 0.0002], (SPEC.rows * SPEC.columns, 3))
    truth = wrinkle_truth(flat, SPEC)
    assert_none(truth)
    assert 0 < truth.energy < MIN_ENERGY
    assert truth.share == pytest.approx(1.0, abs=0.01)
    for lifted in (
        wavy((0.3, 0.1, 0.006, 0.0)) + np.array([0.0, 0.0, 0.2]),
        SPEC.hanging_nodes(np.array([[0, 0.17, 0.5], [0, -0.17, 0.5]])),
    ):
        truth = wrinkle_truth(lifted, SPEC)
        assert_none(truth)
        assert truth.energy == truth.share == truth.contact_portion == 0.0


def test_what_is_folded_over_does_not_count() -> None:
    """Half of the cloth has wrinkles along y and lies face down on the other half, whose wrinkles are along x."""
    wave_x, wave_y = (math.pi / 2, 0.1, 0.004, 0.0), (0.0, 0.1, 0.004, 0.0)
    nodes, over = wavy(wave_x), SPEC.flat_nodes()[:, 0] > SPEC.length_m / 2
    nodes[over] = wavy(wave_y)[over]
    nodes[over, 0] = SPEC.length_m - nodes[over, 0]
    nodes[over, 2] += 0.012
    truth = wrinkle_truth(nodes, SPEC)
    assert axis_error(truth.direction, math.pi / 2) < 5.0
    assert truth.share == pytest.approx(0.5, abs=0.08)


def test_one_upright_crease_does_not_outweigh_the_rest() -> None:
    nodes = wavy((0.0, 0.09, 0.004, 0.0))
    grid = nodes.reshape(SPEC.rows, SPEC.columns, 3)
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


def test_contact_is_the_cloths() -> None:
    cloth = ClothGeometry(SPEC)
    for nodes in (SPEC.flat_nodes(), wavy((0.3, 0.1, 0.006, 0.0)), wavy((1.0, 0.15, 0.004, 2.0))):
        assert wrinkle_truth(nodes, SPEC).contact_portion == cloth.contact_portion_true(nodes)


def test_nodes_of_another_cloth_are_refused() -> None:
    with pytest.raises(SimError, match=r"nodes have shape \(120, 3\); cloth towel has \(169, 3\)"):
        wrinkle_truth(cloth_spec("napkin").flat_nodes(), SPEC)
