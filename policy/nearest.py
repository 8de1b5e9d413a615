"""NearestModel: repeats what the demonstrator did in the most similar step; the baseline of all learning."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.distance import cdist

from layflat.data.arrays import FloatArray
from layflat.policy.trained_model import Progress, RegressionModel, freeze, ignore_progress
from layflat.policy.training_set import Predict, TrainingSet, held_out_rmse

NEIGHBOURS = 5
"""Number of steps whose spread is the standard deviation; the mean is that of the nearest one alone."""
MIN_STD_M = 1e-4
"""Lower bound of the standard deviation: no hand is more exact, and it must be above 0 if all neighbours agree."""


@dataclass(frozen=True, kw_only=True, eq=False)
class NearestModel(RegressionModel):
    """All N demonstrated steps."""

    FORMAT = "layflat-nearest"
    ARRAYS = ("inputs", "input_scale", "actions")

    inputs: FloatArray
    """(N, D) in natural units."""
    actions: FloatArray
    """(N, A) m per step."""

    def __post_init__(self) -> None:
        freeze(self, "inputs", (None, self.layout.size))
        freeze(self, "actions", (len(self.inputs), len(self.outputs)))
        super().__post_init__()

    def predict(self, inputs: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the action of the nearest step (the first of equals), and the deviation of the NEIGHBOURS nearest.

        See `RegressionModel.predict`.
        """
        distances = cdist(self._scaled(inputs), self.inputs / self.input_scale)
        near = np.argsort(distances, axis=1, kind="stable")[:, :NEIGHBOURS]
        return self.actions[near[:, 0]], np.maximum(self.actions[near].std(axis=1), MIN_STD_M)


def fit(training: TrainingSet, progress: Progress = ignore_progress) -> NearestModel:
    """Make a model from all steps of the demonstrations."""
    scale = training.layout.scales()
    model = NearestModel(**training.shared(), inputs=training.inputs, input_scale=scale, actions=training.targets)

    def refit(inputs: FloatArray, targets: FloatArray) -> Predict:
        rest = replace(model, inputs=inputs, actions=targets)
        return lambda queries: rest.predict(queries)[0]

    progress(1, 1, f"{model.n_points} steps stored")
    return replace(model, heldout_rmse_m=held_out_rmse(training, refit))
