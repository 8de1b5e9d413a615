"""Free pickers: the cloth's corners go where they go, and they stay where a real hand could be."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from layflat.sim.cloth.spec import HELD_STRETCH, ClothSpec
from layflat.sim.physics.bullet.cloth import BulletCloth
from layflat.sim.physics.bullet.world import BulletWorld
from layflat.sim.robots.pickers import MAX_SPREAD, FreePickers

SMALL = ClothSpec(
    name="small", length_m=0.15, width_m=0.15, rows=6, columns=6,
    mass_kg=0.015, elastic_n_m=40.0, damping_n_s_m=0.12, bending_n_m=0.1,
)  # fmt: skip
HOME = np.array([[0.0, 0.5, 0.4 / 0.15], [0.0, -0.5, 0.4 / 0.15]]) * 0.15 * np.array([1.0, HELD_STRETCH, 1.0])


@pytest.fixture
def held() -> Iterator[tuple[BulletWorld, BulletCloth, FreePickers]]:
    world = BulletWorld(substep_s=1 / SMALL.rate_hz, table_friction=1.0)
    cloth = world.add_cloth(SMALL)
    nodes = SMALL.hanging_nodes(HOME)
    nodes[:, 0] = 0.0  # a taut hem: a drooping one keeps the cloth moving, and awake
    cloth.set_nodes(nodes)
    pickers = FreePickers(cloth, HOME)
    pickers.grasp()
    yield world, cloth, pickers
    world.close()


def _step(world: BulletWorld, pickers: FreePickers, action: np.ndarray, substeps: int = 24) -> None:
    pickers.start_step(action, substeps)
    for _ in range(substeps):
        pickers.before_substep()
        world.step()


def test_corners_follow_within_a_substep_of_motion(held: tuple[BulletWorld, BulletCloth, FreePickers]) -> None:
    world, cloth, pickers = held
    rng = np.random.default_rng(0)
    for _ in range(10):
        action = rng.uniform(-0.015, 0.015, 6)
        _step(world, pickers, action)
        corners = cloth.nodes()[list(SMALL.corners)]
        allowed = np.abs(action).max() * np.sqrt(3) / 24 + 2e-4
        assert np.linalg.norm(corners - pickers.corner_positions(), axis=1).max() < allowed


def test_each_picker_moves_by_its_own_part_of_the_action(held: tuple[BulletWorld, BulletCloth, FreePickers]) -> None:
    world, _, pickers = held
    action = np.array([0.004, -0.001, 0.006, -0.003, 0.002, -0.005])
    before = pickers.corner_positions()
    _step(world, pickers, action)
    np.testing.assert_allclose(pickers.corner_positions() - before, action.reshape(2, 3), atol=1e-12)
    np.testing.assert_allclose(pickers.position(), pickers.corner_positions().mean(axis=0))


def test_a_cloth_that_hung_still_for_three_seconds_follows(held: tuple[BulletWorld, BulletCloth, FreePickers]) -> None:
    """Bullet puts a still cloth to sleep after about a second unless it is forbidden; it then ignores its anchors."""
    world, cloth, pickers = held
    for _ in range(30):
        _step(world, pickers, np.zeros(6))
    before = cloth.nodes()
    for _ in range(10):
        _step(world, pickers, np.array([0.0, 0.0, 0.01] * 2))
    raised = (cloth.nodes() - before)[:, 2]
    assert raised.min() > 0.08
    assert raised.mean() == pytest.approx(0.1, abs=0.01)


@given(
    actions=st.lists(st.lists(st.floats(min_value=-0.3, max_value=0.3), min_size=6, max_size=6), min_size=1, max_size=8)
)
@settings(max_examples=30, deadline=None)
def test_whatever_is_asked_they_stay_in_the_workspace_and_near_each_other(actions: list[list[float]]) -> None:
    world = BulletWorld(substep_s=1 / SMALL.rate_hz, table_friction=1.0)
    try:
        pickers = FreePickers(world.add_cloth(SMALL), HOME)  # not gripped: their path does not depend on the cloth
        for action in actions:
            pickers.start_step(np.array(action), 4)
            for _ in range(4):
                pickers.before_substep()
            at = pickers.corner_positions()
            assert (at >= np.array(pickers.workspace_low_m) - 1e-9).all()
            assert (at <= np.array(pickers.workspace_high_m) + 1e-9).all()
            assert np.linalg.norm(at[0] - at[1]) <= MAX_SPREAD * SMALL.width_m + 1e-9
    finally:
        world.close()
