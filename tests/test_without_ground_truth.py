"""From demonstration to evaluation in an environment without ground truth, as a real robot is one."""

from __future__ import annotations

from functools import partial

import numpy as np
import pandas as pd

from layflat.app.commands.train import TrainConfig, train
from layflat.app.evaluation.plan import EvaluationPlan
from layflat.app.evaluation.run import run_evaluation
from layflat.app.report.evaluation_page import write_evaluation
from layflat.app.workers.simulated_episode import SimulatedEpisode
from layflat.data import SessionRecorder, open_session, validate
from layflat.data.arrays import FloatArray
from layflat.data.environment_spec import EnvironmentSpec
from layflat.data.session.recorder import EpisodeWriter
from layflat.data.types import Episode, Observation
from layflat.policy.base import Decision
from layflat.policy.environment import Environment
from layflat.policy.rollout import rollout
from layflat.policy.spec import PolicySpec
from layflat.sim.config import SimConfig
from layflat.tests.factories import HANGER

SEEDS = range(6)
LENGTH_M = 0.38


class TableTop(Environment):
    """A cloth that lies where the hanger has let it down: the camera sees how much, and nothing else is known."""

    def __init__(self, config: SimConfig | None = None) -> None:
        self._spec = EnvironmentSpec(robot=HANGER, cloth="towel", physics="real")

    @property
    def spec(self) -> EnvironmentSpec:
        return self._spec

    def reset(self, seed: int) -> None:
        self._place = np.array([0.0, 0.0, LENGTH_M]) + np.random.default_rng(seed).uniform(-0.03, 0.03, 3) * [1, 0, 1]
        self._steps = 0

    def observe(self) -> Observation:
        half = np.array([0.0, 0.15, 0.0])
        contact = np.clip(1.0 - self._place[2] / LENGTH_M, 0.0, 1.0)
        return Observation(
            time_s=0.1 * self._steps,
            corner_positions=[self._place + half, self._place - half],
            holder_position=self._place,
            word=[1.0, 0.0],
            word_strength=0.1,
            contact_portion=float(contact),
        )

    def step(self, action: FloatArray) -> None:
        self._place = np.maximum(self._place + HANGER.unpack(action)[0], [-1.0, 0.0, 0.0])
        self._steps += 1

    def close(self) -> None:
        """Hold nothing."""


class ByHand:
    """A person who lays the cloth forward and down until all of it lies."""

    name, robot = "by-hand", HANGER

    def reset(self, seed: int) -> None:
        """Forget nothing."""

    def act(self, observation: Observation) -> Decision:
        done = observation.contact_portion > 0.985
        return Decision(action=HANGER.pack([0.01, 0.0, -0.01]), stop="converged" if done else None)


def _record(recorder: SessionRecorder, seed: int) -> Episode:
    writers: list[EpisodeWriter] = []

    def start(beginning: Episode) -> EpisodeWriter:
        writers.append(recorder.start(beginning))
        return writers[0]

    episode = rollout(TableTop(), ByHand(), seed=seed, on_start=start)
    writers[0].save(episode)
    return episode


def test_demonstrations_train_a_policy_that_is_evaluated_by_the_camera_alone(tmp_path):
    session_path, model_path = tmp_path / "station.h5", tmp_path / "station.npz"
    with SessionRecorder(session_path, robot=HANGER, cloth="towel") as recorder:
        for seed in SEEDS:
            episode = _record(recorder, seed)
            assert (episode.outcome, episode.flat_area_final, episode.physics) == ("success", None, "real")
    assert validate(session_path) == ()
    with open_session(session_path) as session:
        assert [info.outcome for info in session.infos().values()] == ["success"] * len(SEEDS)
        assert session[0].final_ground_truth is None
        assert {step.ground_truth for step in session[0].steps} == {None}

    train(TrainConfig(data=session_path, model=model_path, policy="gp-word"), force=False)
    plan = EvaluationPlan(
        policies=(PolicySpec.parse(str(model_path)),), robots=("hanger",), cloths=("towel",), seeds=(100, 101)
    )
    results = run_evaluation(plan, tmp_path / "out", workers=2, make=partial(SimulatedEpisode, make_env=TableTop))
    rows = results.rows
    assert list(rows["physics"]) == ["real", "real"]
    assert (rows["contact_final"] > 0.95).all()
    assert rows["contact_final_true"].isna().all()
    assert rows["flat_area_final"].isna().all()
    assert not rows["crashed"].any()
    assert pd.notna(results.summary["groups"][0]["contact_final"]["mean"])
    assert results.summary["groups"][0]["success_rate"] == np.mean(rows["contact_final"] > 0.97)
    assert write_evaluation(results).exists()


def test_the_environments_defaults_say_that_nothing_else_is_known():
    env = TableTop()
    env.reset(0)
    assert env.ground_truth() is None
    assert env.divergence_reason() is None
    assert not env.disturbed
    assert env.success() is False
    assert dict(env.start) == {}
