"""Training sets: the columns that a learner fits, and the error on demonstrations that are left out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from platform import python_version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from layflat.data.arrays import FloatArray, frozen_array
from layflat.data.types import Episode, Provenance
from layflat.policy.base import PolicyError
from layflat.policy.demonstrations import Demonstrations
from layflat.policy.features import FeatureLayout

OUTPUT_SCALE_M = 0.01
"""Usual move in one step, to which learners' bounds are relative. A constant, so that no data set changes a prior."""
MIN_POINTS = 10

Predict = Callable[[FloatArray], FloatArray]
"""(M, D) inputs in natural units -> (M, A) m per step."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainingSet:
    """Inputs and targets of the steps of demonstrations, without the phase ``disturb``; arrays read-only."""

    layout: FeatureLayout
    demonstrations: Demonstrations
    inputs: FloatArray
    """(N, D) in natural units."""
    targets: FloatArray
    """(N, A) m per step."""
    groups: NDArray[np.int64]
    """(N,) number of the step's demonstration."""
    corrections: NDArray[np.bool_]
    """(N,) true where a person decided although a policy was in control."""

    def shared(self, policy: str, seed: int, provenance: Provenance | None, *libraries: str) -> dict[str, Any]:
        """Return the fields of a TrainedModel that follow from the demonstrations; the fit used ``libraries``."""
        given, source = provenance or Provenance(), self.demonstrations
        # The numbers of a fit depend on these, where the caller has not named them.
        own = {"python": python_version(), "numpy": np.__version__} | {name: version(name) for name in libraries}
        return {
            "policy": policy,
            "layout": self.layout,
            "task": source.task,
            "cloth": source.cloth,
            "descriptor": source.descriptor,
            "step_s": source.step_s,
            "seed": seed,
            "demonstrations": len(source),
            "points_available": len(self.inputs),
            "provenance": replace(given, versions={**own, **given.versions}),
        }


def build_training_set(source: Demonstrations | Sequence[Episode], layout: FeatureLayout) -> TrainingSet:
    """Return all steps but those of phase ``disturb``; PolicyError where the demonstrations do not belong together.

    The caller chooses which episodes are worth learning from (no failures, no folds).
    """
    known = Demonstrations.of(source)
    if known.robot != layout.robot:
        raise PolicyError(f"the demonstrations are of robot {known.robot}; the model is for {layout.robot}")
    rows = known.phases != b"disturb"
    count = int(rows.sum())
    if count < MIN_POINTS:
        raise PolicyError(f"the demonstrations hold {count} steps; at least {MIN_POINTS} are needed")
    return TrainingSet(
        layout=layout,
        demonstrations=known,
        inputs=frozen_array(layout.select(known.observations)[rows], (count, layout.size), "inputs"),
        targets=frozen_array(known.actions[rows], (count, layout.robot.size), "targets"),
        groups=known.numbers[rows],
        corrections=known.interventions[rows],
    )


def held_out_rmse(training: TrainingSet, fit: Callable[[FloatArray, FloatArray], Predict]) -> tuple[float, ...] | None:
    """Return (A,) m per step: error on each demonstration of a fit to the others; None where there are no others."""
    labels = np.unique(training.groups)
    if len(labels) < 2:
        return None
    errors = np.empty_like(training.targets)
    for label in labels:
        out = training.groups == label
        errors[out] = training.targets[out] - fit(training.inputs[~out], training.targets[~out])(training.inputs[out])
    return tuple(float(value) for value in np.sqrt((errors**2).mean(axis=0)))
