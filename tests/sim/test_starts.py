"""Starts on purpose: a folded corner, and a cloth that swings ahead."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from data.types import TASKS, Task
from sim.cloth import cloth_spec
from sim.placing import BenchSettings, Placing
from sim.starts import beginning, fold_corner

TOWEL = cloth_spec("towel")


def projected_area(nodes: np.ndarray) -> float:
    a, b, c = (nodes[TOWEL.triangles()[:, k], :2] for k in range(3))
    u, v = b - a, c - a
    return float(0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).sum())


@settings(deadline=None)
@given(along=st.floats(0.1, 0.3), across=st.floats(0.1, 0.3), left=st.booleans())
def test_folding_turns_a_triangle_over(along: float, across: float, left: bool) -> None:
    """Signed area falls by twice the triangle's; what is folded keeps its lengths, and lies inside the cloth, above."""
    flat = TOWEL.flat_nodes()
    folded = fold_corner(flat, TOWEL, (along, across), left=left)
    moved = np.linalg.norm(folded - flat, axis=1) > 1e-9
    cell = TOWEL.length_m / (TOWEL.rows - 1)
    wanted = TOWEL.area_m2 - along * across
    assert projected_area(folded) == pytest.approx(wanted, abs=cell * (along + across))
    inwards = TOWEL.width_m / 2 - flat[:, 1] * (1.0 if left else -1.0)
    inside = flat[:, 0] / along + inwards / across - 1.0
    assert moved[inside < -1e-6].all()
    assert not moved[inside > 1e-6].any()
    edges = np.concatenate([TOWEL.triangles()[:, [0, 1]], TOWEL.triangles()[:, [1, 2]]])
    lengths = [np.linalg.norm(nodes[edges[:, 0]] - nodes[edges[:, 1]], axis=1) for nodes in (flat, folded)]
    stretch = lengths[1] / lengths[0]
    # A cell is longer than the way around the fold, so that edges across it are chords; the others keep their lengths.
    assert stretch.min() > 0.2
    assert stretch.max() < 1 + 1e-9
    turned = folded[:, 2] > flat[:, 2] + 0.012 - 1e-9
    assert turned.any()
    whole = turned[edges].all(axis=1)
    np.testing.assert_allclose(stretch[whole], 1.0, atol=1e-6)
    assert (folded[moved, 0] > -1e-9).all()
    assert (np.abs(folded[moved, 1]) < TOWEL.width_m / 2 + 1e-9).all()


def test_seeds_decide_place_size_and_side() -> None:
    drawn = [beginning("folded-corner", TOWEL, np.random.default_rng(seed)).about for seed in range(20)]
    for name in ("fold_along_m", "fold_across_m", "fold_side"):
        assert len({about[name] for about in drawn}) > 1
    assert {about["fold_side"] for about in drawn} == {-1.0, 1.0}


@pytest.mark.parametrize("task", TASKS)
def test_a_folded_corner_lies_still_with_the_hem_held(task: Task) -> None:
    bench = Placing(BenchSettings(task=task, cloth="towel", start="folded-corner"))
    try:
        bench.reset(3)
        truth, seen = bench.truth(), bench.observe(images=False)
        assert 0.6 < seen.contact_portion < 0.92
        assert 0.6 < truth.flat_area < 0.9
        held = truth.nodes[list(TOWEL.corners)]
        np.testing.assert_allclose(held, seen.corner_positions, atol=0.002)
        assert held[:, 2].max() < 0.012
        for _ in range(5):
            bench.step(np.zeros(2 if task == "hanger" else 6))
        assert bench.instability() is None
        # The crease may still give by some millimetres.
        assert np.linalg.norm(bench.truth().nodes - truth.nodes, axis=1).mean() < 0.001
        assert bench.truth().flat_area == pytest.approx(truth.flat_area, abs=0.02)
    finally:
        bench.close()


@pytest.mark.parametrize("task", TASKS)
def test_a_swinging_cloth_touches_ahead_of_its_holder(task: Task) -> None:
    """Lowered straight on, the free edge comes down in front; a cloth that hangs does not."""
    bench = Placing(BenchSettings(task=task, cloth="towel", start="swinging", camera=False))
    down = np.array([0.0, -0.01] if task == "hanger" else [0.0, 0.0, -0.01] * 2)
    try:
        bench.reset(2)
        assert bench.time_s == 0.0
        assert bench.start["swing_m"] > 0.07
        assert bench.instability() is None
        assert bench.truth().contact_portion_true < 0.05
        for _ in range(5):
            bench.step(down)
            edge = bench.truth().nodes[: TOWEL.columns]
            if edge[:, 2].min() < 0.008:
                break
        assert edge[:, 2].min() < 0.008
        assert edge[:, 0].mean() - bench.holder.position()[0] > 0.03
    finally:
        bench.close()
