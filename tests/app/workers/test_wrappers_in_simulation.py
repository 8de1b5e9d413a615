"""Wrappers of policies on real physics: with them, and without."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from layflat.data.types import FLAT_AREA, Episode
from layflat.policy.base import Policy
from layflat.policy.rollout import rollout
from layflat.policy.spec import PolicySpec
from layflat.policy.wrappers.swing_damping import SwingDampingWrapper
from layflat.sim.config import SimConfig
from layflat.sim.robots.registry import THESIS_ROBOTS, robot_spec
from layflat.sim.simulation import ClothSimulation
from layflat.tests.fake_environment import DownPolicy


def placed(robot: str, start: str, seed: int, *wrappers: str) -> Episode:
    env = ClothSimulation(SimConfig(robot=robot, start=start))
    try:
        return rollout(env, PolicySpec(builtin="scripted", wrappers=wrappers), seed=seed)
    finally:
        env.close()


def ahead_at_touch(robot: str, wrap: Callable[[Policy], Policy]) -> float:
    """How far the free edge is ahead of the holder when it has come down and not swung up again, m."""
    env = ClothSimulation(SimConfig(robot=robot, start="swinging"))
    try:
        env.reset(2)
        policy, columns = wrap(DownPolicy(robot_spec(robot))), env.config.cloth_spec.columns
        policy.reset(2)
        down = False
        for _ in range(60):
            edge = env.ground_truth().nodes[:columns]
            down, before = bool(edge[:, 2].min() < 0.008), down
            if down and before:
                return float(edge[:, 0].mean() - env.robot.position()[0])
            env.step(policy.act(env.observe()).action)
        raise AssertionError("it never comes down")
    finally:
        env.close()


@pytest.mark.parametrize("robot", THESIS_ROBOTS)
def test_a_cloth_that_swings_ahead_is_held_up_until_it_hangs(robot: str) -> None:
    assert ahead_at_touch(robot, lambda policy: policy) > 0.03
    assert abs(ahead_at_touch(robot, SwingDampingWrapper)) < 0.015


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("robot", THESIS_ROBOTS)
def test_a_folded_corner_is_lifted_and_laid_again(robot: str) -> None:
    assert placed(robot, "folded-corner", 5).final_ground_truth.flat_area < FLAT_AREA
    lifted = placed(robot, "folded-corner", 5, "recovery")
    assert lifted.final_ground_truth.flat_area > FLAT_AREA
    assert max(step.observation.holder_position[2] for step in lifted.steps) > 0.4
