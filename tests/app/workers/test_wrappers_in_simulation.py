"""What is put around a policy, on the real bench: with it, and without."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from layflat.app.workers.episode_pool import EpisodeConfig, policy_of
from layflat.data.types import FLAT_AREA, Episode
from layflat.policy.base import Policy
from layflat.policy.rollout import run_disturbances, run_until_stop
from layflat.policy.runner import EpisodeRunner
from layflat.policy.schedule import DisturbanceScheduler
from layflat.policy.wrappers.swing_damping import SwingDampingWrapper
from layflat.sim.config import SimConfig
from layflat.sim.robots.registry import ROBOTS
from layflat.sim.simulation import ClothSimulation
from layflat.tests.fake_environment import DownPolicy


def episode(robot: str, start: str, seed: int, *around: str) -> Episode:
    bench = ClothSimulation(SimConfig(robot=robot, start=start))
    try:
        bench.reset(seed)
        job = EpisodeConfig(robot=robot, cloth="towel", seed=seed, decorators=around)
        run = EpisodeRunner(bench, policy_of(job, bench), seed=seed)
        watch = DisturbanceScheduler()
        return run.episode(run_disturbances(run, watch, run_until_stop(run, watch)))
    finally:
        bench.close()


def ahead_at_touch(robot: str, around: Callable[[Policy], Policy]) -> float:
    """How far the free edge is ahead of the holder when it has come down and not swung up again, m."""
    bench = ClothSimulation(SimConfig(robot=robot, start="swinging"))
    try:
        bench.reset(2)
        policy, columns = around(DownPolicy(robot)), bench.config.cloth_spec.columns
        policy.reset(2)
        down = False
        for _ in range(60):
            edge = bench.ground_truth().nodes[:columns]
            down, before = bool(edge[:, 2].min() < 0.008), down
            if down and before:
                return float(edge[:, 0].mean() - bench.holder.position()[0])
            bench.step(policy.act(bench.observe()).action)
        raise AssertionError("it never comes down")
    finally:
        bench.close()


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_cloth_that_swings_ahead_is_held_up_until_it_hangs(robot: str) -> None:
    assert ahead_at_touch(robot, lambda policy: policy) > 0.03
    assert abs(ahead_at_touch(robot, SwingDampingWrapper)) < 0.015


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("robot", ROBOTS)
def test_a_folded_corner_is_lifted_and_laid_again(robot: str) -> None:
    assert episode(robot, "folded-corner", 5).final_ground_truth.flat_area < FLAT_AREA
    lifted = episode(robot, "folded-corner", 5, "recovery")
    assert lifted.final_ground_truth.flat_area > FLAT_AREA
    assert max(step.observation.holder_position[2] for step in lifted.steps) > 0.4
