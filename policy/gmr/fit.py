"""Learns a mixture of Gaussians from demonstrations; the only user of scikit-learn among the learners.

Expectation maximisation is scikit-learn's; the number of components is the one of the least Bayesian information
criterion (Schwarz 1978), as is usual for mixture regression of demonstrations.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.types import Episode, Provenance
from layflat.policy.features import FeatureLayout
from layflat.policy.gmr.model import GmrModel
from layflat.policy.training_set import OUTPUT_SCALE_M, TrainingSet, build_training_set, held_out_rmse

if TYPE_CHECKING:
    from sklearn.mixture import GaussianMixture

MAX_COMPONENTS = 20
POINTS_PER_COMPONENT = 20
"""At least so many steps for each component on average; with fewer it would describe single moves."""
REGULARISATION = 1e-4
"""Added to the variances, in scaled units: 0.1 mm a step, 1 mm, 0.002 of contact. Keeps a component from collapsing on
columns that never move, such as the y of symmetrical pickers."""
STARTS = 2
MAX_ITERATIONS = 500


def fit(
    episodes: Sequence[Episode],
    layout: FeatureLayout,
    *,
    policy: str,
    seed: int = 0,
    provenance: Provenance | None = None,
    progress: Callable[[int, int, str], None] | None = None,
) -> GmrModel:
    """Learn from whole demonstrations, all of one robot, cloth and step; steps of phase ``disturb`` are left out."""
    taught = build_training_set(episodes, layout)
    joint = _joint(taught.inputs, taught.targets, layout)
    most = min(MAX_COMPONENTS, max(1, len(joint) // POINTS_PER_COMPONENT))
    tried: list[tuple[float, GaussianMixture]] = []
    for components in range(1, most + 1):
        mixture = mixture_of(joint, components, seed)
        tried.append((float(mixture.bic(joint)), mixture))
        if progress is not None:
            progress(components, most, f"{components} components: criterion {tried[-1][0]:.0f}")
    _, best = min(tried, key=lambda pair: pair[0])
    return _model(best, taught, policy, seed, provenance)


def mixture_of(joint: FloatArray, components: int, seed: int) -> GaussianMixture:
    """The likeliest mixture of so many components over rows (N, D + A), by expectation maximisation."""
    from sklearn.exceptions import ConvergenceWarning  # here: who only rolls out need not wait for it
    from sklearn.mixture import GaussianMixture

    mixture = GaussianMixture(
        components, reg_covar=REGULARISATION, n_init=STARTS, max_iter=MAX_ITERATIONS, random_state=seed
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # identical steps make fewer clusters than asked for
        return mixture.fit(joint)


def _joint(inputs: FloatArray, targets: FloatArray, layout: FeatureLayout) -> FloatArray:
    """(N, D + A) in scaled units."""
    return np.hstack([inputs / layout.scales(), targets / OUTPUT_SCALE_M])


def _model(
    mixture: GaussianMixture, taught: TrainingSet, policy: str, seed: int, provenance: Provenance | None
) -> GmrModel:
    def made(of: GaussianMixture, heldout: tuple[float, ...] | None) -> GmrModel:
        return GmrModel(
            **taught.shared(policy, seed, provenance, "scikit-learn"),
            input_scale=taught.layout.scales(),
            output_scale_m=OUTPUT_SCALE_M,
            weights=of.weights_,
            means=of.means_,
            covariances=of.covariances_,
            heldout_rmse_m=heldout,
        )

    def without(inputs: FloatArray, targets: FloatArray) -> Callable[[FloatArray], FloatArray]:
        rest = mixture_of(_joint(inputs, targets, taught.layout), mixture.n_components, seed)
        return lambda queries: made(rest, None).predict(queries)[0]

    return made(mixture, held_out_rmse(taught, without))
