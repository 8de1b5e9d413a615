"""Recorded cloth is shown as the bench's own camera showed it."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.sim.camera.replay_scene import ReplayScene
from layflat.sim.config import SimConfig
from layflat.sim.errors import SimError
from layflat.sim.robots.registry import ROBOTS
from layflat.sim.simulation import ClothSimulation

ARM_SHARE = 0.02
"""Of the pixels: the edges of the arm, whose joints follow from where its hanger was."""


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_stage_shows_what_the_camera_saw(robot: str) -> None:
    bench = ClothSimulation(SimConfig(robot=robot, noise=False))
    bench.reset(3)
    down = np.array([0.006, -0.011] if robot == "hanger" else [0.006, 0.0, -0.011] * 2)
    for _ in range(12):
        bench.step(down)
    seen, ground_truth = bench.observe(), bench.ground_truth()
    bench.close()
    with ReplayScene(robot, "towel") as stage:
        before = stage.capture(ground_truth.nodes + 0.1, seen.holder_position + 0.1)[0]
        rgb, depth = stage.capture(ground_truth.nodes, seen.holder_position)
    assert (rgb != before).any(axis=2).mean() > 2 * ARM_SHARE
    other = (rgb != seen.rgb).any(axis=2)
    if robot == "pickers":
        assert not other.any()
        np.testing.assert_array_equal(depth, seen.depth)
    else:
        assert other.mean() < ARM_SHARE


def test_what_is_no_such_cloth_is_refused() -> None:
    with pytest.raises(SimError, match="silk"):
        ReplayScene("pickers", "silk")
    with ReplayScene("pickers", "towel") as stage, pytest.raises(SimError, match=r"\(4, 3\).*towel"):
        stage.capture(np.zeros((4, 3)), np.zeros(3))
