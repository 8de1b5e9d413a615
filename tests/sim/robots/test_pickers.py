"""Free pickers: the cloth's corners go where they go, and they stay where a real hand could be."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from layflat.sim.cloth.spec import HELD_STRETCH
from layflat.sim.physics.bullet.cloth import BulletCloth
from layflat.sim.robots.pickers import MAX_SPREAD, FreePickers
from layflat.tests.sim.helpers import cloth_in_world, run, small_cloth

SMALL = small_cloth(0.15, 6, 6, mass_kg=0.015)
HOME = np.array([[0.0, 0.5, 0.4 / 0.15], [0.0, -0.5, 0.4 / 0.15]]) * 0.15 * np.array([1.0, HELD_STRETCH, 1.0])


@pytest.fixture
def held() -> Iterator[tuple[BulletCloth, FreePickers]]:
    """Give a hanging cloth and the pickers that hold it."""
    nodes = SMALL.hanging_nodes(HOME)
    nodes[:, 0] = 0.0  # a taut hem: a drooping one keeps the cloth moving, and awake
    with cloth_in_world(SMALL, nodes) as cloth:
        pickers = FreePickers(cloth, HOME)
        pickers.grasp()
        yield cloth, pickers


def _step(held: tuple[BulletCloth, FreePickers], action: np.ndarray, substeps: int = 24) -> None:
    cloth, pickers = held
    pickers.start_step(action, substeps)
    run(cloth.world, substeps, pickers.before_substep)


def test_corners_follow_within_a_substep_of_motion(held: tuple[BulletCloth, FreePickers]) -> None:
    cloth, pickers = held
    rng = np.random.default_rng(0)
    for _ in range(10):
        action = rng.uniform(-0.015, 0.015, 6)
        _step(held, action)
        corners = cloth.nodes()[list(SMALL.corners)]
        allowed = np.abs(action).max() * np.sqrt(3) / 24 + 2e-4
        assert np.linalg.norm(corners - pickers.corner_positions(), axis=1).max() < allowed


def test_each_picker_moves_by_its_own_part_of_the_action(held: tuple[BulletCloth, FreePickers]) -> None:
    _, pickers = held
    action = np.array([0.004, -0.001, 0.006, -0.003, 0.002, -0.005])
    before = pickers.corner_positions()
    _step(held, action)
    np.testing.assert_allclose(pickers.corner_positions() - before, action.reshape(2, 3), atol=1e-12)
    np.testing.assert_allclose(pickers.position(), pickers.corner_positions().mean(axis=0))


def test_a_cloth_that_hung_still_for_three_seconds_follows(held: tuple[BulletCloth, FreePickers]) -> None:
    """Bullet puts a still cloth to sleep after about a second unless it is forbidden; it then ignores its anchors."""
    cloth, _ = held
    for _ in range(30):
        _step(held, np.zeros(6))
    before = cloth.nodes()
    for _ in range(10):
        _step(held, np.array([0.0, 0.0, 0.01] * 2))
    raised = (cloth.nodes() - before)[:, 2]
    assert raised.min() > 0.08
    assert raised.mean() == pytest.approx(0.1, abs=0.01)


@given(
    actions=st.lists(st.lists(st.floats(min_value=-0.3, max_value=0.3), min_size=6, max_size=6), min_size=1, max_size=8)
)
@settings(max_examples=30, deadline=None)
def test_they_stay_in_the_workspace_and_near_each_other(actions: list[list[float]]) -> None:
    with cloth_in_world(SMALL) as cloth:
        pickers = FreePickers(cloth, HOME)  # without a grasp: their path does not depend on the cloth
        for action in actions:
            pickers.start_step(np.array(action), 4)
            for _ in range(4):
                pickers.before_substep()
            corners = pickers.corner_positions()
            assert (corners >= np.array(pickers.workspace_low_m) - 1e-9).all()
            assert (corners <= np.array(pickers.workspace_high_m) + 1e-9).all()
            assert np.linalg.norm(corners[0] - corners[1]) <= MAX_SPREAD * SMALL.width_m + 1e-9
