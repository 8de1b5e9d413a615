"""Recorded cloth is shown as the simulation's own camera showed it."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.sim.camera.replay_scene import ReplayScene
from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.errors import SimError
from layflat.sim.robots.registry import THESIS_ROBOTS
from layflat.tests.sim.helpers import simulation

ARM_SHARE = 0.02
"""Of the pixels: the edges of the arm, whose joints follow from where its hanger was."""


@pytest.mark.parametrize("robot", THESIS_ROBOTS)
def test_the_scene_shows_what_the_camera_saw(robot: str) -> None:
    with simulation(robot, 3, cloth="towel", camera=True, noise=False) as sim:
        for _ in range(12):
            sim.step(sim.spec.robot.pack([0.006, 0.0, -0.011]))
        seen, ground_truth = sim.observe(), sim.ground_truth()
    with ReplayScene(robot, cloth_spec("towel")) as scene:
        before = scene.capture(ground_truth.nodes + 0.1, seen.holder_position + 0.1)[0]
        rgb, depth = scene.capture(ground_truth.nodes, seen.holder_position)
    assert (rgb != before).any(axis=2).mean() > 2 * ARM_SHARE
    other = (rgb != seen.rgb).any(axis=2)
    if robot == "pickers":
        assert not other.any()
        np.testing.assert_array_equal(depth, seen.depth)
    else:
        assert other.mean() < ARM_SHARE


def test_nodes_of_another_cloth_are_refused() -> None:
    with ReplayScene("pickers", cloth_spec("towel")) as scene, pytest.raises(SimError, match=r"\(4, 3\).*towel"):
        scene.capture(np.zeros((4, 3)), np.zeros(3))
