"""Starts on purpose: a folded corner, and a cloth that swings ahead."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.sim.cloth.spec import cloth_spec
from layflat.sim.config import SimConfig
from layflat.sim.robots.registry import ROBOTS
from layflat.sim.simulation import ClothSimulation

TOWEL = cloth_spec("towel")


def test_seeds_decide_place_size_and_side() -> None:
    drawn = [_start(seed) for seed in (4, 5)]
    for name in ("fold_along_m", "fold_across_m", "holder_x_m"):
        assert len({start[name] for start in drawn}) == len(drawn)
    assert {start["fold_side"] for start in drawn} == {-1.0, 1.0}


def _start(seed: int) -> dict[str, float]:
    bench = ClothSimulation(SimConfig(robot="pickers", cloth="towel", start="folded-corner", camera=False))
    try:
        bench.reset(seed)
        assert not bench.disturbed
        corner = 0 if bench.start["fold_side"] > 0 else TOWEL.columns - 1
        nodes, other = bench.ground_truth().nodes, TOWEL.columns - 1 - corner
        # Of the free edge one end lies on the cloth, nearer to the middle and to the holder.
        assert abs(nodes[corner, 1]) < abs(nodes[other, 1]) - 0.05
        assert nodes[corner, 0] > nodes[other, 0] + 0.05
        # Turned over as a page is, down to its last cell.
        inner = TOWEL.columns + (1 if corner == 0 else corner - 1)
        assert nodes[corner, 0] > nodes[inner, 0]
        assert abs(nodes[corner, 1]) < abs(nodes[inner, 1])
        return bench.start
    finally:
        bench.close()


def test_a_folded_corner_leaves_no_crease_when_it_is_lifted() -> None:
    """Edges keep their lengths: what a hand folds, gravity unfolds. Nodes that are put into a fold stay creased."""
    bench = ClothSimulation(SimConfig(robot="hanger", cloth="towel", start="folded-corner", camera=False))
    try:
        bench.reset(0)
        assert bench.cloth.is_layered(bench.ground_truth().nodes)
        while bench.robot.position()[2] < 0.46:
            bench.step(np.array([-0.008 if bench.robot.position()[0] > 0 else 0.0, 0.010]))
            assert bench.divergence_reason() is None
        for _ in range(10):
            bench.step(np.zeros(2))
        nodes = bench.ground_truth().nodes
        assert not bench.cloth.is_layered(nodes)
        assert bench.cloth.stretch(nodes).min() > 0.9
    finally:
        bench.close()


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_folded_corner_lies_still_with_the_hem_held(robot: str) -> None:
    bench = ClothSimulation(SimConfig(robot=robot, cloth="towel", start="folded-corner"))
    try:
        bench.reset(3)
        ground_truth, seen = bench.ground_truth(), bench.observe(images=False)
        assert 0.6 < seen.contact_portion < 0.92
        assert 0.6 < ground_truth.flat_area < 0.9
        held = ground_truth.nodes[list(TOWEL.corners)]
        np.testing.assert_allclose(held, seen.corner_positions, atol=0.002)
        assert held[:, 2].max() < 0.012
        for _ in range(5):
            bench.step(np.zeros(2 if robot == "hanger" else 6))
        assert bench.divergence_reason() is None
        # The fold may still give by some millimetres.
        assert np.linalg.norm(bench.ground_truth().nodes - ground_truth.nodes, axis=1).mean() < 0.001
        assert bench.ground_truth().flat_area == pytest.approx(ground_truth.flat_area, abs=0.02)
    finally:
        bench.close()


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_swinging_cloth_touches_ahead_of_its_holder(robot: str) -> None:
    """Lowered straight on, the free edge comes down in front; a cloth that hangs does not."""
    bench = ClothSimulation(SimConfig(robot=robot, cloth="towel", start="swinging", camera=False))
    down = np.array([0.0, -0.01] if robot == "hanger" else [0.0, 0.0, -0.01] * 2)
    try:
        bench.reset(2)
        assert bench.time_s == 0.0
        assert bench.start["swing_m"] > 0.07
        assert bench.divergence_reason() is None
        assert bench.ground_truth().contact_portion_true < 0.05
        for _ in range(5):
            bench.step(down)
            edge = bench.ground_truth().nodes[: TOWEL.columns]
            if edge[:, 2].min() < 0.008:
                break
        assert edge[:, 2].min() < 0.008
        assert edge[:, 0].mean() - bench.robot.position()[0] > 0.03
    finally:
        bench.close()
