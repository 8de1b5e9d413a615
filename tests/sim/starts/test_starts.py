"""Starts on purpose: a folded corner, and a cloth that swings ahead."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.robots.registry import THESIS_ROBOTS
from layflat.tests.sim.helpers import simulation

TOWEL = cloth_spec("towel")


def test_seeds_decide_place_size_and_side() -> None:
    drawn = [_start(seed) for seed in (4, 5)]
    for name in ("fold_along_m", "fold_across_m", "holder_x_m"):
        assert len({start[name] for start in drawn}) == len(drawn)
    assert {start["fold_side"] for start in drawn} == {-1.0, 1.0}


def _start(seed: int) -> dict[str, float]:
    with simulation("pickers", seed, cloth="towel", start="folded-corner") as sim:
        assert not sim.disturbed
        corner = 0 if sim.start["fold_side"] > 0 else TOWEL.columns - 1
        nodes, other = sim.ground_truth().nodes, TOWEL.columns - 1 - corner
        # Of the free edge one end lies on the cloth, nearer to the middle and to the holder.
        assert abs(nodes[corner, 1]) < abs(nodes[other, 1]) - 0.05
        assert nodes[corner, 0] > nodes[other, 0] + 0.05
        # Turned over as a page is, down to its last cell.
        inner = TOWEL.columns + (1 if corner == 0 else corner - 1)
        assert nodes[corner, 0] > nodes[inner, 0]
        assert abs(nodes[corner, 1]) < abs(nodes[inner, 1])
        return sim.start


def test_a_folded_corner_leaves_no_crease_when_it_is_lifted() -> None:
    """Edges keep their lengths: what a hand folds, gravity unfolds. Nodes that are put into a fold stay creased."""
    with simulation("hanger", 0, cloth="towel", start="folded-corner") as sim:
        assert sim.cloth.is_layered(sim.ground_truth().nodes)
        while sim.robot.position()[2] < 0.46:
            sim.step(np.array([-0.008 if sim.robot.position()[0] > 0 else 0.0, 0.010]))
            assert sim.divergence_reason() is None
        for _ in range(10):
            sim.step(np.zeros(2))
        nodes = sim.ground_truth().nodes
        assert not sim.cloth.is_layered(nodes)
        assert sim.cloth.stretch(nodes).min() > 0.9


@pytest.mark.parametrize("robot", THESIS_ROBOTS)
def test_a_quick_start_is_at_the_place_of_the_whole_one_after_a_third_of_its_steps(robot: str) -> None:
    seen, substeps = [], []
    for start in ("hanging", "hanging-quick"):
        with simulation(robot, 31, cloth="napkin", start=start) as sim:
            seen.append(sim.robot.corner_positions())
            substeps.append(sim.world.substeps_done)
            nodes = sim.ground_truth().nodes
            assert sim.cloth.stretch(nodes).max() < 1.2
            assert 0.05 < nodes[:, 2].min() < 0.25
    np.testing.assert_allclose(*seen, atol=1e-3)
    assert substeps[1] < 0.36 * substeps[0]


@pytest.mark.parametrize("robot", THESIS_ROBOTS)
def test_a_folded_corner_lies_still_with_the_hem_held(robot: str) -> None:
    with simulation(robot, 3, cloth="towel", start="folded-corner", camera=True) as sim:
        ground_truth, seen = sim.ground_truth(), sim.observe(images=False)
        assert 0.6 < seen.contact_portion < 0.92
        assert 0.6 < ground_truth.flat_area < 0.9
        held = ground_truth.nodes[list(TOWEL.corners)]
        np.testing.assert_allclose(held, seen.corner_positions, atol=0.002)
        assert held[:, 2].max() < 0.012
        for _ in range(5):
            sim.step(sim.spec.robot.zeros())
        assert sim.divergence_reason() is None
        # The fold may still give by some millimetres.
        assert np.linalg.norm(sim.ground_truth().nodes - ground_truth.nodes, axis=1).mean() < 0.001
        assert sim.ground_truth().flat_area == pytest.approx(ground_truth.flat_area, abs=0.02)


@pytest.mark.parametrize("robot", THESIS_ROBOTS)
def test_a_swinging_cloth_touches_ahead_of_its_holder(robot: str) -> None:
    """Lowered straight on, the free edge comes down in front; a cloth that hangs does not."""
    with simulation(robot, 2, cloth="towel", start="swinging") as sim:
        down = sim.spec.robot.pack([0.0, 0.0, -0.01])
        assert sim.time_s == 0.0
        assert sim.start["swing_m"] > 0.07
        assert sim.divergence_reason() is None
        assert sim.ground_truth().contact_portion_true < 0.05
        for _ in range(5):
            sim.step(down)
            edge = sim.ground_truth().nodes[: TOWEL.columns]
            if edge[:, 2].min() < 0.008:
                break
        assert edge[:, 2].min() < 0.008
        assert edge[:, 0].mean() - sim.robot.position()[0] > 0.03
