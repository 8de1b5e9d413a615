"""The crumpled start: about 74 % of the cloth lies, nothing is unstable, and a seed is a start."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from layflat.sim.simulation import ClothSimulation
from layflat.tests.sim.helpers import simulation


@pytest.fixture(scope="module")
def crumpled() -> Iterator[ClothSimulation]:
    with simulation(seed=201, cloth="towel", task="smooth", camera=True) as sim:
        yield sim


def test_about_three_quarters_lie_and_the_rest_is_wrinkles(crumpled: ClothSimulation) -> None:
    ground_truth, spec = crumpled.ground_truth(), crumpled.config.cloth_spec
    assert 0.68 <= ground_truth.contact_portion_true <= 0.82
    assert ground_truth.flat_area > ground_truth.contact_portion_true - 0.05  # a fold would take twice its area away
    assert ground_truth.nodes[:, 2].max() > 4 * spec.margin_m
    assert crumpled.divergence_reason() is None
    assert np.percentile(crumpled.cloth.stretch(ground_truth.nodes), 95) < 1.12


def test_the_pickers_hold_their_corners_on_the_table_nearer_than_the_cloth_is_wide(crumpled: ClothSimulation) -> None:
    seen, spec = crumpled.observe(images=False), crumpled.config.cloth_spec
    np.testing.assert_allclose(crumpled.ground_truth().nodes[list(spec.corners)], seen.corner_positions, atol=0.002)
    assert np.abs(seen.corner_positions[:, 2] - spec.margin_m).max() < 0.002
    assert np.linalg.norm(np.diff(seen.corner_positions, axis=0)) < 0.9 * spec.width_m
    assert crumpled.time_s == 0.0
    assert seen.word.any()  # Three of ten starts have wrinkles without a direction.


def test_what_was_drawn_is_in_the_record(crumpled: ClothSimulation) -> None:
    assert {"push_back_1_m", "push_inward_2_m", "push_steps"} <= set(crumpled.start)
    assert crumpled.start["contact_portion_true"] == crumpled.ground_truth().contact_portion_true
