"""The settings of its simulation in a recorded episode, and its journal beside the rollout."""

from __future__ import annotations

import numpy as np
import pytest

from layflat.data import open_session, validate
from layflat.data.session.journal_reader import read_journal
from layflat.data.session.parts import journals, parts_folder
from layflat.data.session.recorder import SessionRecorder
from layflat.policy.rollout import rollout
from layflat.policy.scripted.baselines import ZeroPolicy
from layflat.sim.cloth.registry import PREFIX
from layflat.sim.config import SimConfig
from layflat.sim.robots.registry import THESIS_ROBOTS
from layflat.sim.simulation import ClothSimulation


@pytest.fixture(params=THESIS_ROBOTS)
def env(request):
    simulation = ClothSimulation(SimConfig(robot=request.param, cloth="napkin", table_friction=0.9))
    yield simulation
    simulation.close()


def test_the_file_holds_what_makes_the_same_simulation_again(env, tmp_path, differences):
    robot, path = env.spec.robot, tmp_path / "s.h5"
    joints: list = []
    with SessionRecorder(path, robot=robot, cloth="napkin") as recorder:
        running: list = []

        def start(initial):
            joints.append(env.joint_angles())
            running.append(recorder.start(initial))
            return running[0]

        episode = rollout(env, ZeroPolicy(robot), seed=3, max_steps=3, on_start=start)
        running[0].close()
        (journal,) = journals(parts_folder(path))
        left = read_journal(journal).episode
        assert differences(left.steps, episode.steps[:2]) == []
        assert left.sim_config == episode.sim_config
        running[0].save(episode)
    with open_session(path) as session:
        found = session[0]
    assert differences(found, episode) == []
    assert validate(path) == ()
    size = {key: value for key, value in found.sim_config.items() if key.startswith(PREFIX)}
    assert size == {"cloth_length_m": env.spec.cloth_shape.length_m, "cloth_width_m": env.spec.cloth_shape.width_m}
    settings = {key: value for key, value in found.sim_config.items() if key not in size}
    config = {"robot": found.robot.name, "cloth": found.cloth, "step_s": found.step_s, **settings}
    assert SimConfig(**config) == env.config
    np.testing.assert_array_equal(found.initial_joints, joints[0])
    assert found.initial_joints.shape == ((7,) if robot.name == "hanger" else (0,))
    assert found.provenance.operator
