"""What a recorded episode says of its bench, and its journal beside the loop."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from layflat.data import open_session, validate
from layflat.data.session.journal_reader import read_journal
from layflat.data.session.parts import journals, parts_folder
from layflat.data.session.recorder import SessionRecorder
from layflat.policy.rollout import rollout
from layflat.policy.scripted.baselines import ZeroPolicy
from layflat.sim.cloth.spec import cloth_spec
from layflat.sim.config import SimConfig
from layflat.sim.disturbances.presets import DISTURBANCES, disturbance_spec
from layflat.sim.robots.registry import ROBOTS
from layflat.sim.simulation import ClothSimulation


@pytest.fixture(params=ROBOTS)
def bench(request):
    placing = ClothSimulation(SimConfig(robot=request.param, cloth="napkin", table_friction=0.9))
    placing.reset(3)
    yield placing
    placing.close()


def test_the_file_holds_what_makes_the_same_bench_again(bench, tmp_path, differences):
    robot, path = bench.spec.robot, Path(tmp_path / "s.h5")
    joints = bench.joint_angles()
    with SessionRecorder(path, robot=robot, cloth="napkin") as recorder:
        running: list = []
        episode = rollout(
            bench,
            ZeroPolicy(robot),
            seed=3,
            max_steps=3,
            begin=lambda beginning: running.append(recorder.begin(beginning)) or running[0],
        )
        running[0].close()
        (journal,) = journals(parts_folder(path))
        left = read_journal(journal).episode
        assert differences(left.steps, episode.steps[:2]) == []
        assert left.sim_config == episode.sim_config
        running[0].keep(episode)
    with open_session(path) as session:
        found = session[0]
    assert differences(found, episode) == []
    assert validate(path) == ()
    assert SimConfig(robot=found.robot.name, cloth=found.cloth, step_s=found.step_s, **found.sim_config) == bench.config
    np.testing.assert_array_equal(found.initial_joints, joints)
    assert found.initial_joints.shape == ((7,) if robot.name == "hanger" else (0,))
    assert found.provenance.operator


@pytest.mark.parametrize("name", [name for name in DISTURBANCES if name != "none"])
def test_the_plan_in_the_record_is_the_one_that_is_carried_out(name):
    planned = disturbance_spec(name).sample(np.random.default_rng(5), cloth_spec("napkin")).described()
    assert json.loads(json.dumps(planned)) == planned
