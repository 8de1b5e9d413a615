"""What was recorded under other conditions is simulated again under them, to the bit, from the file alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from layflat.app.commands.replay import compare, rerun
from layflat.app.support.errors import UsageError
from layflat.app.workers.process import process_pool
from layflat.data.session.reader import open_session
from layflat.data.session.recorder import SessionRecorder
from layflat.data.types import Episode
from layflat.policy.rollout import rollout
from layflat.policy.spec import SCRIPTED, PolicySpec
from layflat.sim.conditions.variation import variation
from layflat.sim.config import SimConfig
from layflat.sim.simulation import ClothSimulation


def record(robot: str) -> Episode:
    drawn = variation(["all"]).sample(11) | {"observation_latency_steps": 1, "action_latency_steps": 2}
    config = SimConfig(robot=robot, cloth="napkin", start="hanging-quick").under(drawn)
    env = ClothSimulation(config)
    episode = rollout(env, PolicySpec(builtin=SCRIPTED), seed=11, max_steps=5)
    env.close()
    return episode


@pytest.mark.parametrize("robot", [pytest.param("hanger", marks=pytest.mark.slow), "pickers"])
def test_a_session_brings_its_conditions_back(robot: str, tmp_path: Path) -> None:
    with process_pool(1) as pool:  # Bullet repeats itself only in a process that has not stepped a simulation yet.
        episode: Episode = pool.schedule(record, args=[robot]).result()
    with SessionRecorder(tmp_path / "s.h5", robot=episode.robot, cloth="napkin") as recorder:
        recorder.save(episode)
    with open_session(tmp_path / "s.h5") as session:
        recorded = session.episode("demo_0")
    assert recorded.sim_config == episode.sim_config
    assert recorded.decision_s == episode.decision_s
    assert recorded.decision_s is not None
    assert compare(recorded, rerun(recorded)).identical
    other = compare(recorded, rerun(recorded, ["mass_factor=3", "camera_x_m=0"]))
    assert not other.identical
    assert other.node_error_m.max() > 1e-4
    with pytest.raises(UsageError, match="must be a number between"):
        rerun(recorded, ["mass_factor=30"])


def test_an_old_session_without_conditions_has_the_usual_ones(tmp_path: Path) -> None:
    with process_pool(1) as pool:
        episode: Episode = pool.schedule(usual, args=[]).result()
    old = {"start": "hanging-quick", "table_friction": 1.0, "control": "impedance", "noise": True}
    again = rerun(replace(episode, sim_config=old))
    assert compare(episode, again).identical
    assert np.isfinite(again.contact()).all()


def usual() -> Episode:
    env = ClothSimulation(SimConfig(robot="pickers", cloth="napkin", start="hanging-quick"))
    episode = rollout(env, PolicySpec(builtin=SCRIPTED), seed=3, max_steps=3)
    env.close()
    return episode
