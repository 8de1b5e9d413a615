"""Flat area, contact, layers and divergence of given nodes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import qmc

from layflat.sim.cloth.geometry import CONTACT_TOLERANCE_M, ClothGeometry
from layflat.sim.cloth.registry import cloth_spec
from layflat.tests.sim.helpers import fold_corner, small_cloth

SMALL = small_cloth(0.2, 6, 5, width_m=0.16)
GEOMETRY = ClothGeometry(SMALL)


def _moved(nodes: np.ndarray, angle: float, x_m: float, y_m: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return nodes @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + [x_m, y_m, 0.0]


@given(angle=st.floats(-3.1, 3.1), x_m=st.floats(-0.3, 0.6), y_m=st.floats(-0.3, 0.3))
def test_flat_area_does_not_depend_on_where_it_lies(angle: float, x_m: float, y_m: float) -> None:
    flat = _moved(SMALL.flat_nodes(), angle, x_m, y_m)
    assert GEOMETRY.flat_area(flat) == pytest.approx(1.0)
    turned = _moved(SMALL.flat_nodes() * [1.0, -1.0, 1.0], angle, x_m, y_m)
    assert GEOMETRY.flat_area(turned) == pytest.approx(-1.0)


@given(crease=st.floats(0.05, 0.95))
def test_a_fold_counts_twice_against_the_area(crease: float) -> None:
    """Folded over at ``crease`` of the length, a share of 1 - crease lies on its reverse: crease - (1 - crease)."""
    nodes = SMALL.flat_nodes()
    beyond = nodes[:, 0] > crease * SMALL.length_m
    nodes[beyond, 0] = 2 * crease * SMALL.length_m - nodes[beyond, 0]
    nodes[beyond, 2] += 2 * SMALL.margin_m
    row = 1 / (SMALL.rows - 1)
    assert GEOMETRY.flat_area(nodes) == pytest.approx(2 * crease - 1, abs=2 * row)
    # Contact is blind to folds, but not to the second layer's height; the row that spans the crease counts in part.
    assert GEOMETRY.contact_portion_true(nodes) == pytest.approx(crease, abs=row)


def test_areas_of_a_cloth_in_the_air_are_zero() -> None:
    assert GEOMETRY.flat_area(SMALL.flat_nodes(z_m=0.3)) == 0.0
    assert GEOMETRY.contact_portion_true(SMALL.flat_nodes(z_m=0.3)) == 0.0
    assert GEOMETRY.contact_portion_true(SMALL.flat_nodes()) == 1.0


@given(tilt=st.floats(-1.0, 1.0), roll=st.floats(-1.0, 1.0), base=st.floats(-0.05, 0.06), stretch=st.floats(0.9, 1.1))
def test_contact_of_a_tilted_sheet_is_the_area_below(tilt: float, roll: float, base: float, stretch: float) -> None:
    """Against a count of points scattered over the same plane, however the sheet is meshed, and however stretched."""
    flat = SMALL.flat_nodes(z_m=0.0)
    nodes = flat * [stretch, stretch, 1.0]
    nodes[:, 2] = base + tilt * flat[:, 0] + roll * flat[:, 1]
    points = qmc.Halton(2, seed=0).random(4000) * [SMALL.length_m, SMALL.width_m] - [0.0, SMALL.width_m / 2]
    below = base + points @ [tilt, roll] < SMALL.margin_m + CONTACT_TOLERANCE_M
    assert GEOMETRY.contact_portion_true(nodes) == pytest.approx(below.mean(), abs=0.012)


def test_flat_area_counts_stretch_and_contact_does_not() -> None:
    nodes = SMALL.flat_nodes() * [1.02, 1.03, 1.0]
    assert GEOMETRY.flat_area(nodes) == pytest.approx(1.02 * 1.03)
    assert GEOMETRY.contact_portion_true(nodes) == pytest.approx(1.0)


@given(lift=st.lists(st.floats(0.0, 0.1), min_size=30, max_size=30), more=st.floats(0.0, 0.05))
def test_contact_never_grows_when_the_cloth_rises(lift: list[float], more: float) -> None:
    nodes = SMALL.flat_nodes()
    nodes[:, 2] += lift
    portion = GEOMETRY.contact_portion_true(nodes)
    assert 0.0 <= portion <= 1.0
    assert GEOMETRY.contact_portion_true(nodes + np.array([0.0, 0.0, more])) <= portion


@pytest.mark.parametrize(
    ("moved", "at_s", "reason"), [((0, 0, 0.3), 0.1, None), ((5.0, 0, 0), 0.1, "moves"), ((5.0, 0, 0), 0.0, None)]
)
def test_a_node_that_is_too_fast_has_diverged(moved: tuple[float, ...], at_s: float, reason: str | None) -> None:
    geometry, rest = ClothGeometry(SMALL), SMALL.flat_nodes()
    assert geometry.divergence_at(rest, 0.0) is None
    found = geometry.divergence_at(rest + np.array(moved), at_s)
    assert found is None if reason is None else reason in str(found)


def test_a_torn_edge_or_a_node_that_is_not_finite_has_diverged() -> None:
    far = SMALL.flat_nodes()
    far[7] += [0.0, 0.0, 0.2]
    assert "stretched" in str(GEOMETRY.divergence_at(far, 0.0))
    for wrong in (np.nan, np.inf):
        broken = SMALL.flat_nodes()
        broken[3, 1] = wrong
        assert "finite" in str(GEOMETRY.divergence_at(broken, 0.0))


def test_layers_are_not_bends_or_wrinkles() -> None:
    spec = cloth_spec("towel")
    geometry, flat = ClothGeometry(spec), spec.flat_nodes()
    for legs in (0.09, 0.15, 0.3):
        assert geometry.is_layered(fold_corner(flat, spec, (legs, legs), left=True))
    half_laid = np.where(
        flat[:, :1] < 0.17, flat, np.stack([np.full(169, 0.17), flat[:, 1], flat[:, 0] - 0.166], axis=1)
    )
    # As steep as wrinkles get that a stick has pushed up.
    wrinkled = flat + np.array([0.0, 0.0, 0.04]) * np.sin(flat[:, :1] * 2 * np.pi / 0.1)
    for nodes in (flat, half_laid, wrinkled, np.full_like(flat, np.inf)):
        assert not geometry.is_layered(nodes)


def test_a_heap_is_stepped_finer_than_a_fold_and_a_fold_finer_than_a_sheet() -> None:
    spec = cloth_spec("towel")
    geometry, flat = ClothGeometry(spec), spec.flat_nodes()
    folded = fold_corner(flat, spec, (0.15, 0.15), left=True)
    assert [geometry.refinement(nodes) for nodes in (flat, 1.1 * flat, folded, 1.1 * folded)] == [1, 1, 2, 2]
    assert [geometry.refinement(nodes) for nodes in (1.22 * flat, 1.22 * folded, 1.17 * folded)] == [8, 8, 4]
    assert geometry.refinement(np.full_like(flat, np.nan)) == 1
    assert [geometry.is_jammed(nodes) for nodes in (flat, 1.17 * folded, 1.22 * folded)] == [False, False, True]


def test_the_held_edge_stops_above_what_lies_below_it_and_nowhere_else() -> None:
    spec = cloth_spec("towel")
    geometry, floor = ClothGeometry(spec), 2 * spec.margin_m
    corners = spec.corners_at(0.2, 0.10)
    heap = spec.hanging_nodes(corners)
    rows = heap.reshape(spec.rows, spec.columns, 3)
    rows[:-4, :, 2] = np.linspace(0.004, 0.03, spec.rows - 4)[:, None]
    middle = corners.mean(axis=0)
    assert geometry.drop_to_heap_m(heap, middle) == pytest.approx([0.03 + floor - 0.10])
    # Pressed in already, it may not go deeper; it is not lifted.
    assert geometry.drop_to_heap_m(heap, middle - [0.0, 0.0, 0.08]) == pytest.approx([0.0])
    # Two points: a heap under picker 2 does not stop picker 1.
    rows[:-3, : spec.columns // 2 + 3, 0] -= 0.2
    first, second = geometry.drop_to_heap_m(heap, corners)
    assert first == -np.inf
    assert second == pytest.approx(0.03 + floor - 0.10)
    laid = spec.flat_nodes()
    assert geometry.drop_to_heap_m(laid, laid[list(spec.corners)]) == pytest.approx([-np.inf] * 2)
