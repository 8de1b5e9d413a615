"""Fit of a dynamic movement primitive to demonstrations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.types import Provenance
from layflat.policy.base import PolicyError
from layflat.policy.demonstrations import Demonstrations
from layflat.policy.dmp.model import DmpModel, path
from layflat.policy.features import FeatureLayout
from layflat.policy.trained_model import Progress
from layflat.policy.training_set import TrainingSet

BASIS = 25
"""Number of basis functions for each axis."""
RIDGE = 1e-6
"""Keeps the weights of basis functions without much effect small; relative to their mean square response."""


def fit(
    training: TrainingSet,
    *,
    policy: str,
    seed: int = 0,
    provenance: Provenance | None = None,
    progress: Progress | None = None,
) -> DmpModel:
    """Fit a model that is named ``policy`` to the placing phase; what follows a disturbance is left out.

    Each demonstration has its own start, end and duration; the weights are common to all. Positions are linear in the
    weights, which therefore follow from least squares on positions, without second derivatives.
    """
    source, step_s = training.demonstrations, training.demonstrations.step_s
    paths = [_demonstrated_path(source, number, training.layout) for number in range(len(source))]
    goal, weights, duration_s = _fit_paths(paths, step_s)
    if progress is not None:
        progress(1, 1, f"{len(paths)} paths of {duration_s:.1f} s on average")
    return DmpModel(
        **training.shared(policy, seed, provenance),
        goal=goal,
        weights=weights,
        duration_s=duration_s,
        heldout_rmse_m=_held_out_rmse(source, paths),
    )


def _demonstrated_path(source: Demonstrations, number: int, layout: FeatureLayout) -> FloatArray:
    """Return the coordinates (T + 1, A) m before each step of placing and after the last."""
    own = np.flatnonzero(source.numbers == number)
    placed = own[source.phases[own] == b"place"]
    if len(placed) < 2:
        raise PolicyError(
            f"the demonstration of seed {source.seeds[number]} holds {len(placed)} steps of placing; 2 are needed"
        )
    before, after = layout.select(source.observations), layout.select(source.next_positions)
    return np.vstack([before[placed], after[own[len(placed) - 1]]])


def _fit_paths(paths: Sequence[FloatArray], step_s: float) -> tuple[FloatArray, FloatArray, float]:
    """Return the goal, weights and duration of a primitive for these paths."""
    axes = paths[0].shape[1]
    responses, rests = [], []
    for way in paths:
        n_steps = len(way) - 1
        spring = path(way[0], way[-1], np.zeros((axes, BASIS)), step_u=1 / n_steps, n_steps=n_steps)
        # Response of an axis at rest to each basis function alone.
        zeros = np.zeros(BASIS)
        responses.append(path(zeros, zeros, np.eye(BASIS), step_u=1 / n_steps, n_steps=n_steps))
        rests.append(way - spring)
    response, rest = np.vstack(responses), np.vstack(rests)
    gram = response.T @ response
    gram[np.diag_indices(BASIS)] += RIDGE * np.trace(gram) / BASIS
    # In row order, as a file restores it: sums over a transposed array differ in the last bit.
    weights: FloatArray = np.ascontiguousarray(np.linalg.solve(gram, response.T @ rest).T)
    goal = np.mean([way[-1] for way in paths], axis=0)
    return goal, weights, step_s * float(np.mean([len(way) - 1 for way in paths]))


def _held_out_rmse(source: Demonstrations, paths: Sequence[FloatArray]) -> tuple[float, ...] | None:
    """Return (A,) m per step: error of the moves from each demonstration's start, learned from the others."""
    if len(paths) < 2:
        return None
    errors = []
    for k, way in enumerate(paths):
        goal, weights, duration_s = _fit_paths([*paths[:k], *paths[k + 1 :]], source.step_s)
        n_steps = len(way) - 1
        moves = np.diff(path(way[0], goal, weights, step_u=source.step_s / duration_s, n_steps=n_steps), axis=0)
        errors.append(source.actions[source.numbers == k][:n_steps] - moves)
    return tuple(float(value) for value in np.sqrt((np.vstack(errors) ** 2).mean(axis=0)))
