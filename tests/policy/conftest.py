"""Small worlds for policies: observations, demonstrations and models without a simulator and without GPy."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from data.types import Episode, Observation, Step, Task, Truth, action_size
from policy.features import input_set
from policy.gp_model import GpModel, Hyperparameters, weights


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
    task: Task = "hanger",
    seed: int = 0,
    cloth: str = "towel",
    tick_s: float = 0.1,
    phases: Sequence[str] | None = None,
) -> Episode:
    truth = Truth(nodes=np.zeros((4, 3)), contact_portion_true=0.0, flat_area=0.0)
    steps = tuple(
        Step(observation=o, truth=truth, action=a, phase="place" if phases is None else phases[k])
        for k, (o, a) in enumerate(zip(observations, actions, strict=True))
    )
    return Episode(
        task=task,
        cloth=cloth,
        seed=seed,
        source="scripted",
        steps=steps,
        final_observation=observations[-1],
        final_truth=truth,
        stopped_by="converged",
        outcome="success",
        tick_s=tick_s,
    )


def _model(task: Task = "hanger", inputs: str = "all", points: int = 25, seed: int = 0, policy: str = "") -> GpModel:
    """A model with given hyperparameters on random points: what a fit would make, without the fit."""
    rng = np.random.default_rng(seed)
    layout = input_set(task, inputs)
    outputs = action_size(task)
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


@pytest.fixture(scope="session")
def observe() -> Callable[..., Observation]:
    return _observe


@pytest.fixture(scope="session")
def episode_of() -> Callable[..., Episode]:
    return _episode


@pytest.fixture(scope="session")
def model_of() -> Callable[..., GpModel]:
    return _model
