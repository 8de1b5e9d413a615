"""Small worlds for policies: observations, demonstrations and models without a simulator and without GPy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from layflat.data.robot import RobotSpec
from layflat.data.types import Episode, GroundTruth, Observation, Step
from layflat.policy import registry
from layflat.policy.features import input_set
from layflat.policy.gp.kernel import Hyperparameters, weights
from layflat.policy.gp.model import GpModel
from layflat.policy.trained_model import TrainedModel
from layflat.tests.factories import HANGER

GP_INPUTS = {
    "gp-word": "all",
    "gp-baseline": "position",
    "gp-contact": "position+contact",
    "gp-direction": "position+word",
    "gp-finish": "all",
}


def _observe(
    x: float = 0.0,
    z: float = 0.3,
    *,
    y: float = 0.17,
    contact: float = 0.0,
    word: Sequence[float] = (0.0, 0.0),
    time_s: float = 0.0,
) -> Observation:
    return Observation(
        time_s=time_s,
        corner_positions=np.array([[x, y, z], [x, -y, z]]),
        holder_position=np.array([x, 0.0, z]),
        word=np.array(word),
        word_strength=float(np.linalg.norm(word)),
        contact_portion=contact,
    )


def _episode(
    observations: Sequence[Observation],
    actions: np.ndarray,
    *,
    robot: RobotSpec = HANGER,
    seed: int = 0,
    cloth: str = "towel",
    step_s: float = 0.1,
    phases: Sequence[str] | None = None,
) -> Episode:
    ground_truth = GroundTruth(nodes=np.zeros((4, 3)), contact_portion_true=0.0, flat_area=0.0)
    steps = tuple(
        Step(observation=o, ground_truth=ground_truth, action=a, phase="place" if phases is None else phases[k])
        for k, (o, a) in enumerate(zip(observations, actions, strict=True))
    )
    return Episode(
        robot=robot,
        cloth=cloth,
        seed=seed,
        source="scripted",
        steps=steps,
        final_observation=observations[-1],
        final_ground_truth=ground_truth,
        stopped_by="converged",
        outcome="success",
        step_s=step_s,
    )


def _model(
    robot: RobotSpec = HANGER, inputs: str = "all", points: int = 25, seed: int = 0, policy: str = ""
) -> GpModel:
    """A model with given hyperparameters on random points: what a fit would make, without the fit."""
    rng = np.random.default_rng(seed)
    layout = input_set(robot, inputs)
    outputs = robot.size
    matrix = rng.uniform(-0.3, 0.5, (points, layout.size))
    targets = rng.normal(0.0, 0.7, (points, outputs))
    hyper = Hyperparameters(
        kernel="se",
        length_scales=np.repeat(rng.uniform(0.5, 1.5, (outputs, 1)), layout.size, axis=1),
        variance=rng.uniform(0.5, 2.0, outputs),
        noise=rng.uniform(1e-3, 1e-2, outputs),
    )
    return GpModel(
        policy=policy or ("gp-baseline" if inputs == "position" else "gp-word"),
        layout=layout,
        cloth="towel",
        inputs=matrix,
        input_scale=layout.scales(),
        alpha=weights(matrix / layout.scales(), targets, hyper),
        output_scale_m=0.01,
        hyper=hyper,
        heldout_rmse_m=tuple(rng.uniform(0.001, 0.002, outputs)),
        demonstrations=3,
        points_available=points,
        seed=seed,
    )


def _taught(robot: RobotSpec) -> list[Episode]:
    """Three demonstrations of a way down and forward, as long as their seeds say."""
    episodes = []
    for seed in range(3):
        rng, n_steps = np.random.default_rng(seed), 45 + 5 * seed
        share = np.linspace(0.0, 1.0, n_steps + 1)
        seen = [
            _observe(0.4 * s + rng.normal(0, 1e-3), 0.4 * (1 - s), contact=s, word=(np.cos(s), np.sin(s)))
            for s in share
        ]
        move = np.array([0.4, -0.4] if robot == HANGER else [0.4, 0.0, -0.4] * 2) / n_steps
        actions = move + rng.normal(0, 3e-4, (n_steps, len(move)))
        episode = _episode(seen[:-1], actions, robot=robot, seed=seed)
        episodes.append(replace(episode, final_observation=seen[-1]))
    return episodes


@pytest.fixture(scope="session")
def learned_of() -> Callable[[str, RobotSpec], TrainedModel]:
    """A model of any trainable policy by name; those of Gaussian processes without a fit, which takes a second each."""

    @cache
    def made(name: str, robot: RobotSpec) -> TrainedModel:
        if name in GP_INPUTS:
            return _model(robot, GP_INPUTS[name], policy=name)
        return registry.train(name, _taught(robot))

    return made


@pytest.fixture(scope="session")
def observe() -> Callable[..., Observation]:
    return _observe


@pytest.fixture(scope="session")
def episode_of() -> Callable[..., Episode]:
    return _episode


@pytest.fixture(scope="session")
def model_of() -> Callable[..., GpModel]:
    return _model
