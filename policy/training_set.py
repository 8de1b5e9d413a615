"""Demonstrations as arrays: what every learner begins with, and how it is tested on those left out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from platform import python_version
from typing import Any

import numpy as np

from layflat.data.arrays import FloatArray, frozen_array
from layflat.data.types import Episode, Provenance, actions_of
from layflat.policy.base import PolicyError
from layflat.policy.features import FeatureLayout

OUTPUT_SCALE_M = 0.01
"""A usual move in one step, to which learners' bounds are relative. A constant, so that no data set changes a prior."""
MIN_POINTS = 10

Predict = Callable[[FloatArray], FloatArray]
"""(M, D) inputs in natural units -> (M, A) m per step."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainingSet:
    """What was seen and done in whole demonstrations of one robot, cloth and step; arrays read-only."""

    layout: FeatureLayout
    episodes: tuple[Episode, ...]
    inputs: FloatArray
    """(N, D) in natural units."""
    targets: FloatArray
    """(N, A) m per step."""
    groups: np.ndarray
    """(N,) number of the demonstration that each step belongs to."""
    corrections: np.ndarray
    """(N,) true where a person decided although a policy had the lead."""

    def shared(self, policy: str, seed: int, provenance: Provenance | None, *libraries: str) -> dict[str, Any]:
        """The fields of ``Learned`` that follow from the demonstrations; ``libraries`` are those that the fit used."""
        given, first = provenance or Provenance(), self.episodes[0]
        # What the numbers of a fit depend on, where the caller has not said.
        own = {"python": python_version(), "numpy": np.__version__} | {name: version(name) for name in libraries}
        return {
            "policy": policy,
            "layout": self.layout,
            "task": first.task,
            "cloth": first.cloth,
            "descriptor": first.descriptor,
            "step_s": first.step_s,
            "seed": seed,
            "demonstrations": len(self.episodes),
            "points_available": len(self.inputs),
            "provenance": replace(given, versions={**own, **given.versions}),
        }


def build_training_set(episodes: Sequence[Episode], layout: FeatureLayout) -> TrainingSet:
    """All steps but those of phase ``disturb``; PolicyError where the demonstrations do not go together.

    Which episodes are worth learning from (no failures, no folds) is the caller's choice.
    """
    _check_common(episodes, layout)
    kept = [[step for step in episode.steps if step.phase != "disturb"] for episode in episodes]
    count = sum(len(steps) for steps in kept)
    if count < MIN_POINTS:
        raise PolicyError(f"the demonstrations hold {count} steps; at least {MIN_POINTS} are needed")
    size = layout.robot.size
    return TrainingSet(
        layout=layout,
        episodes=tuple(episodes),
        inputs=frozen_array(np.concatenate([layout.matrix(steps) for steps in kept]), (count, layout.size), "inputs"),
        targets=frozen_array(
            np.concatenate([actions_of(steps).reshape(-1, size) for steps in kept]), (count, size), "targets"
        ),
        groups=np.repeat(np.arange(len(kept)), [len(steps) for steps in kept]),
        corrections=np.array([step.intervention for steps in kept for step in steps]),
    )


def held_out_rmse(training: TrainingSet, fit: Callable[[FloatArray, FloatArray], Predict]) -> tuple[float, ...] | None:
    """(A,) m per step: error on each demonstration by what ``fit`` makes of the others; None where there are none."""
    labels = np.unique(training.groups)
    if len(labels) < 2:
        return None
    errors = np.empty_like(training.targets)
    for label in labels:
        out = training.groups == label
        errors[out] = training.targets[out] - fit(training.inputs[~out], training.targets[~out])(training.inputs[out])
    return tuple(float(value) for value in np.sqrt((errors**2).mean(axis=0)))


def _check_common(episodes: Sequence[Episode], layout: FeatureLayout) -> None:
    """The demonstrations share the robot of the layout, and among themselves the cloth, the step and the descriptor."""
    if not episodes:
        raise PolicyError("there are no demonstrations to learn from; at least one is needed")
    first = episodes[0]
    for number, episode in enumerate(episodes):
        if episode.robot != layout.robot:
            raise PolicyError(f"demonstration {number} is of robot {episode.robot}; the model is for {layout.robot}")
        if episode.cloth != first.cloth:
            raise PolicyError(f"demonstrations mix the cloths {first.cloth} and {episode.cloth}; choose one")
        if episode.task != first.task:
            raise PolicyError(f"demonstrations mix the tasks {first.task} and {episode.task}; choose one")
        if episode.step_s != first.step_s:
            raise PolicyError(f"demonstrations mix steps of {first.step_s} s and {episode.step_s} s; choose one")
        if episode.descriptor != first.descriptor:
            raise PolicyError(
                f"demonstrations mix the descriptors {first.descriptor} and {episode.descriptor}; choose one"
            )
