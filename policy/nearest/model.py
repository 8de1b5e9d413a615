"""Nearest neighbour: does what the demonstrator did in the most similar step. The floor that learning has to beat."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.distance import cdist

from layflat.data.arrays import FloatArray
from layflat.data.types import Episode, Provenance
from layflat.policy.base import PolicyError
from layflat.policy.features import FeatureLayout
from layflat.policy.trained_model import RegressionModel, freeze
from layflat.policy.training_set import build_training_set, held_out_rmse

NEIGHBOURS = 5
"""Whose spread is the deviation; the mean is the nearest one's alone."""
LEAST_STD_M = 1e-4
"""Of a prediction: no hand is more exact, and a deviation must be above 0 where all neighbours agree."""


@dataclass(frozen=True, kw_only=True, eq=False)
class NearestModel(RegressionModel):
    """All demonstrated steps."""

    FORMAT: ClassVar[str] = "layflat-nearest"
    ARRAYS: ClassVar[tuple[str, ...]] = ("inputs", "input_scale", "actions")

    inputs: FloatArray
    """(N, D) in natural units."""
    input_scale: FloatArray
    """(D,) what each column is divided by before distances are taken."""
    actions: FloatArray
    """(N, A) m per step."""

    def __post_init__(self) -> None:
        freeze(self, "inputs", (None, self.layout.size))
        freeze(self, "input_scale", (self.layout.size,))
        freeze(self, "actions", (len(self.inputs), self.layout.robot.size))
        if not len(self.inputs):
            raise PolicyError("a model needs at least one point")
        if not (self.input_scale > 0).all():
            raise PolicyError(f"input_scale holds {self.input_scale.min():g}; all must be above 0")
        super().__post_init__()

    @property
    def points(self) -> int:
        return len(self.inputs)

    def predict(self, inputs: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """The nearest step's action, and the deviation among the NEIGHBOURS nearest; of equals the first."""
        distances = cdist(self._queries(inputs) / self.input_scale, self.inputs / self.input_scale)
        near = np.argsort(distances, axis=1, kind="stable")[:, :NEIGHBOURS]
        return self.actions[near[:, 0]], np.maximum(self.actions[near].std(axis=1), LEAST_STD_M)


def fit(
    episodes: Sequence[Episode],
    layout: FeatureLayout,
    *,
    policy: str,
    seed: int = 0,
    provenance: Provenance | None = None,
    progress: Callable[[int, int, str], None] | None = None,
) -> NearestModel:
    """Keep all steps of the demonstrations."""
    taught = build_training_set(episodes, layout)
    model = NearestModel(
        **taught.shared(policy, seed, provenance),
        inputs=taught.inputs,
        input_scale=layout.scales(),
        actions=taught.targets,
    )

    def without(inputs: FloatArray, targets: FloatArray) -> Callable[[FloatArray], FloatArray]:
        return lambda queries: replace(model, inputs=inputs, actions=targets).predict(queries)[0]

    model = replace(model, heldout_rmse_m=held_out_rmse(taught, without))
    if progress is not None:
        progress(1, 1, f"{model.points} steps kept")
    return model
