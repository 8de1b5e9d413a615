"""A robot of one's own: a class and a registry entry make it simulate, observe, draw, and learn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import layflat
from layflat.data.robot import one_point
from layflat.data.session.recorder import SessionRecorder
from layflat.policy import model_io, registry
from layflat.policy.environment import Environment
from layflat.sim.camera.replay_scene import ReplayScene
from layflat.sim.cloth.registry import cloth_spec
from layflat.sim.config import SimConfig
from layflat.sim.env import ClothPlaceEnv
from layflat.sim.errors import SimError
from layflat.sim.robots.pickers import FreePickers
from layflat.sim.robots.registry import ROBOTS, robot_spec
from layflat.tests.sim.helpers import simulation


class TwinPickers(FreePickers):
    """Two pickers that move together along x, y and z."""

    spec = one_point("twin-pickers", dx=0, dy=1, dz=2)


@pytest.fixture(autouse=True)
def _registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(ROBOTS, "twin-pickers", TwinPickers)


def test_it_holds_moves_and_is_guided() -> None:
    with simulation("twin-pickers", 3, cloth="towel") as sim:
        environment: Environment = sim
        before = environment.observe().corner_positions
        for _ in range(4):
            environment.step(np.array([0.006, 0.003, -0.01]))
        moved = environment.observe().corner_positions - before
        np.testing.assert_allclose(moved, np.tile([0.024, 0.012, -0.04], (2, 1)), atol=1e-9)
        hand = environment.observe().holder_position + np.array([0.01, 0.0, 0.0])
        np.testing.assert_allclose(environment.guide(hand), [0.01, 0.0, 0.0], atol=1e-9)
        np.testing.assert_allclose(sim.ground_truth().nodes[list(sim.config.cloth_spec.corners)],
                                   environment.observe().corner_positions, atol=0.002)  # fmt: skip
        assert environment.divergence_reason() is None


def test_every_start_and_disturbance_that_suits_it_works() -> None:
    for start in ("folded-corner", "swinging"):
        with simulation("twin-pickers", 1, start=start) as sim:
            assert sim.disturb("push") is not None
            sim.step(sim.spec.robot.zeros())
            assert sim.divergence_reason() is None
    with pytest.raises(SimError, match="moves both corners"):
        SimConfig(robot="twin-pickers", task="smooth")


def test_it_is_drawn_and_has_a_gymnasium_environment() -> None:
    env = ClothPlaceEnv("twin-pickers", cloth="napkin")
    assert env.action_space.shape == (3,)
    seen, _ = env.reset(seed=1)
    assert env.observation_space.contains(seen)
    nodes, holder = env.simulation.ground_truth().nodes, seen["holder_position"]
    env.close()
    with ReplayScene("twin-pickers", cloth_spec("napkin")) as scene:
        assert scene.render(nodes, holder, 80, 60).std() > 10
    assert robot_spec("twin-pickers").action_names == ("dx", "dy", "dz")


def test_it_records_learns_and_places(tmp_path: Path) -> None:
    env = layflat.make_env(robot="twin-pickers", cloth="napkin")
    scripted, demos = layflat.load_policy("scripted"), tmp_path / "demos.h5"
    with SessionRecorder(demos, robot=env.spec.robot, cloth="napkin") as recorder:
        for seed in (1, 2):
            recorder.save(layflat.rollout(env, scripted, seed=seed))
    with layflat.open_session(demos) as session:
        assert [episode.outcome for episode in session] == ["success", "success"]
        assert session[0].robot == env.spec.robot
        model_io.save(registry.train("nearest", session[:]), tmp_path / "model.npz")
    episode = layflat.rollout(env, layflat.load_policy(str(tmp_path / "model.npz")), seed=3)
    env.close()
    assert episode.robot == env.spec.robot
    assert episode.steps[0].action.shape == (3,)
    assert episode.outcome == "success"
