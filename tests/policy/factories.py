"""Observations, demonstrations and models without a simulator and without GPy, for the tests of policies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from layflat.data.robot import RobotSpec
from layflat.data.types import Episode, GroundTruth, Observation, Step
from layflat.policy import registry
from layflat.policy.features import input_set
from layflat.policy.gp.kernel import Hyperparameters, weights
from layflat.policy.gp.model import GpModel
from layflat.policy.trained_model import TrainedModel
from layflat.policy.training_set import build_training_set
from layflat.tests.factories import HANGER


def observe(
    x: float = 0.0,
    z: float = 0.3,
    *,
    y: float = 0.17,
    contact: float = 0.0,
    word: Sequence[float] = (0.0, 0.0),
    **fields: Any,
) -> Observation:
    """Return what is seen of a cloth that is held at (x, +-y, z)."""
    return Observation(
        corner_positions=[[x, y, z], [x, -y, z]],
        holder_position=[x, 0.0, z],
        word=word,
        word_strength=float(np.linalg.norm(word)),
        contact_portion=contact,
        **({"time_s": 0.0} | fields),
    )


def episode_of(
    observations: Sequence[Observation],
    actions: np.ndarray,
    *,
    robot: RobotSpec = HANGER,
    seed: int = 0,
    phases: Sequence[str] | None = None,
    **fields: Any,
) -> Episode:
    """Return a demonstration with these observations before, and actions in, its steps."""
    ground_truth = GroundTruth(nodes=np.zeros((4, 3)), contact_portion_true=0.0, flat_area=0.0)
    steps = tuple(
        Step(observation=o, ground_truth=ground_truth, action=a, phase="place" if phases is None else phases[k])
        for k, (o, a) in enumerate(zip(observations, actions, strict=True))
    )
    values = {"cloth": "towel", "final_observation": observations[-1], "source": "scripted", "outcome": "success"}
    return Episode(
        robot=robot,
        seed=seed,
        steps=steps,
        final_ground_truth=ground_truth,
        stopped_by="converged",
        **(values | fields),
    )


def gp_model(robot: RobotSpec = HANGER, inputs: str = "all", points: int = 25, seed: int = 0, policy: str = "gp-word"):
    """Return a model with given hyperparameters on random points, without a fit."""
    rng = np.random.default_rng(seed)
    layout = input_set(robot, inputs)
    matrix = rng.uniform(-0.3, 0.5, (points, layout.size))
    targets = rng.normal(0.0, 0.7, (points, robot.size))
    hyper = Hyperparameters(
        kernel="se",
        length_scales=np.repeat(rng.uniform(0.5, 1.5, (robot.size, 1)), layout.size, axis=1),
        variance=rng.uniform(0.5, 2.0, robot.size),
        noise=rng.uniform(1e-3, 1e-2, robot.size),
    )
    return GpModel(
        policy=policy,
        layout=layout,
        cloth="towel",
        inputs=matrix,
        input_scale=layout.scales(),
        alpha=weights(matrix / layout.scales(), targets, hyper),
        output_scale_m=0.01,
        hyper=hyper,
        heldout_rmse_m=tuple(rng.uniform(0.001, 0.002, robot.size)),
        demonstrations=3,
        points_available=points,
        seed=seed,
    )


def demonstrations(robot: RobotSpec) -> list[Episode]:
    """Return three demonstrations of different length, down and forward."""
    episodes = []
    for seed in range(3):
        rng, n_steps = np.random.default_rng(seed), 45 + 5 * seed
        seen = [
            observe(0.4 * s + rng.normal(0, 1e-3), 0.4 * (1 - s), contact=s, word=(np.cos(s), np.sin(s)))
            for s in np.linspace(0.0, 1.0, n_steps + 1)
        ]
        move = robot.pack([0.4, 0.0, -0.4]) / n_steps
        actions = move + rng.normal(0, 3e-4, (n_steps, robot.size))
        episode = episode_of(seen[:-1], actions, robot=robot, seed=seed)
        episodes.append(replace(episode, final_observation=seen[-1]))
    return episodes


@cache
def trained_model(name: str, robot: RobotSpec) -> TrainedModel:
    """Return a model of any trainable policy; those of Gaussian processes without a fit, which takes a second each."""
    if name.startswith("gp-"):
        return gp_model(robot, registry.LEARNERS[name].inputs, policy=name)
    return registry.train(name, demonstrations(robot))


def fit_with(fit, episodes: Sequence[Episode], inputs="all", *, policy="gp-word", seed=0, **options: Any) -> Any:
    """Return the model of a ``fit`` on these demonstrations and a named input set."""
    training = build_training_set(episodes, inputs, policy=policy, seed=seed)
    return fit(training, **options)
