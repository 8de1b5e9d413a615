"""Fit of a mixture of Gaussians to demonstrations.

scikit-learn does the expectation maximisation. The number of components is the one with the least Bayesian information
criterion (Schwarz 1978), as is usual for mixture regression of demonstrations.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.types import Provenance
from layflat.policy.gmr.model import GmrModel
from layflat.policy.trained_model import Progress
from layflat.policy.training_set import OUTPUT_SCALE_M, Predict, TrainingSet, held_out_rmse

if TYPE_CHECKING:
    from sklearn.mixture import GaussianMixture

MAX_COMPONENTS = 20
POINTS_PER_COMPONENT = 20
"""Least average number of steps for each component; with fewer, components would describe single moves."""
REGULARISATION = 1e-4
"""Added to the variances, in scaled units: 0.1 mm a step, 1 mm, 0.002 of contact. Keeps a component from collapsing on
columns that never move, such as the y of symmetrical pickers."""
STARTS = 2
MAX_ITERATIONS = 500


def fit(
    training: TrainingSet,
    *,
    policy: str,
    seed: int = 0,
    provenance: Provenance | None = None,
    progress: Progress | None = None,
) -> GmrModel:
    """Fit a model that is named ``policy``; ``progress`` is called after each number of components."""
    scales = training.layout.scales()

    def join(inputs: FloatArray, targets: FloatArray) -> FloatArray:
        return np.hstack([inputs / scales, targets / OUTPUT_SCALE_M])

    def model_of(mixture: GaussianMixture, heldout_rmse_m: tuple[float, ...] | None = None) -> GmrModel:
        return GmrModel(
            **training.shared(policy, seed, provenance, "scikit-learn"),
            input_scale=scales,
            output_scale_m=OUTPUT_SCALE_M,
            weights=mixture.weights_,
            means=mixture.means_,
            covariances=mixture.covariances_,
            heldout_rmse_m=heldout_rmse_m,
        )

    def refit(inputs: FloatArray, targets: FloatArray) -> Predict:
        rest = model_of(fit_mixture(join(inputs, targets), best.n_components, seed))
        return lambda queries: rest.predict(queries)[0]

    joint = join(training.inputs, training.targets)
    most = min(MAX_COMPONENTS, max(1, len(joint) // POINTS_PER_COMPONENT))
    tried: list[tuple[float, GaussianMixture]] = []
    for components in range(1, most + 1):
        mixture = fit_mixture(joint, components, seed)
        tried.append((float(mixture.bic(joint)), mixture))
        if progress is not None:
            progress(components, most, f"{components} components: criterion {tried[-1][0]:.0f}")
    _, best = min(tried, key=lambda pair: pair[0])
    return model_of(best, held_out_rmse(training, refit))


def fit_mixture(joint: FloatArray, components: int, seed: int) -> GaussianMixture:
    """Return the likeliest mixture of so many components over rows (N, D + A), by expectation maximisation."""
    from sklearn.exceptions import ConvergenceWarning  # imported here because a rollout does not need it
    from sklearn.mixture import GaussianMixture

    mixture = GaussianMixture(
        components, reg_covar=REGULARISATION, n_init=STARTS, max_iter=MAX_ITERATIONS, random_state=seed
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # identical steps make fewer clusters than asked for
        return mixture.fit(joint)
