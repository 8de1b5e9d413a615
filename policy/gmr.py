"""Gaussian mixture regression (Ghahramani and Jordan 1994; Calinon, Guenter and Billard 2007).

A mixture of Gaussians over inputs and outputs is conditioned on the inputs. With component k of weight w_k, mean
(m_x, m_y) and covariance ((S_xx, S_xy), (S_yx, S_yy)), all in scaled units:

    h_k(x)  = w_k N(x; m_x, S_xx) / sum over the components
    m_k(x)  = m_y + S_yx S_xx^-1 (x - m_x)
    S_k     = S_yy - S_yx S_xx^-1 S_xy
    mean    = sum h_k m_k
    var     = sum h_k (diag S_k + m_k^2) - mean^2

Unlike a Gaussian process it does not fade: far from the data it follows the plane of the nearest component.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import LinAlgError, cholesky, solve_triangular
from scipy.special import logsumexp

from layflat.data.arrays import FloatArray
from layflat.policy.base import PolicyError
from layflat.policy.trained_model import Progress, RegressionModel, freeze, ignore_progress
from layflat.policy.training_set import OUTPUT_SCALE_M, Predict, TrainingSet, held_out_rmse

if TYPE_CHECKING:
    from sklearn.mixture import GaussianMixture

SUM_TOLERANCE = 1e-6
MAX_COMPONENTS = 20
POINTS_PER_COMPONENT = 20
"""Least average number of steps for each component; with fewer, components would describe single moves."""
REGULARISATION = 1e-4
"""Added to the variances, in scaled units: 0.1 mm a step, 1 mm, 0.002 of contact. Keeps a component from collapsing on
columns that never move, such as the y of symmetrical pickers."""
STARTS = 2
MAX_ITERATIONS = 500


class _Conditional(NamedTuple):
    """One component, conditioned on the inputs."""

    log_weight: float
    """Log of w_k and of the density's factor."""
    mean_x: FloatArray
    mean_y: FloatArray
    whitening: FloatArray
    """(D, D) inverse of the lower factor of S_xx."""
    gain: FloatArray
    """(A, D) S_yx S_xx^-1."""
    variance: FloatArray
    """(A,) diagonal of S_k."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GmrModel(RegressionModel):
    """Mixture of K components over D inputs and A outputs."""

    FORMAT = "layflat-gmr"
    ARRAYS = ("input_scale", "weights", "means", "covariances")
    SETTINGS: ClassVar[Mapping[str, type]] = {"output_scale_m": float}
    POINTS, POINT_NAME = "weights", "components"

    output_scale_m: float
    """Unit of the outputs, m per step."""
    weights: FloatArray
    """(K,) above 0, sum 1."""
    means: FloatArray
    """(K, D + A) scaled inputs, then scaled outputs."""
    covariances: FloatArray
    """(K, D + A, D + A) of the same."""

    def __post_init__(self) -> None:
        size = self.layout.size + len(self.outputs)
        freeze(self, "weights", (None,))
        freeze(self, "means", (len(self.weights), size))
        freeze(self, "covariances", (len(self.weights), size, size))
        if not (len(self.weights) and (self.weights > 0).all() and abs(self.weights.sum() - 1) < SUM_TOLERANCE):
            raise PolicyError(f"weights sum to {self.weights.sum():g}; they must be above 0 and sum to 1")
        self._require_positive("output_scale_m")
        super().__post_init__()
        self._components  # noqa: B018  refuses an invalid covariance here, not in the first step

    @cached_property
    def _components(self) -> tuple[_Conditional, ...]:
        parts = zip(self.weights, self.means, self.covariances, strict=True)
        return tuple(self._conditional(*part) for part in parts)

    def _conditional(self, weight: float, mean: FloatArray, covariance: FloatArray) -> _Conditional:
        d = self.layout.size
        try:
            factor = cholesky(covariance, lower=True)
        except LinAlgError as error:
            raise PolicyError("a covariance is not positive: it cannot be conditioned on") from error
        # The factor's own blocks, without any difference: S_yx S_xx^-1 = L_yx L_xx^-1 and S_k = L_yy L_yy^T.
        whitening = solve_triangular(factor[:d, :d], np.eye(d), lower=True)
        log_weight = float(np.log(weight) - np.log(np.diag(factor)[:d]).sum() - 0.5 * d * np.log(2 * np.pi))
        gain, variance = factor[d:, :d] @ whitening, (factor[d:, d:] ** 2).sum(axis=1)
        return _Conditional(log_weight, mean[:d], mean[d:], whitening, gain, variance)

    def predict(self, inputs: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Predict mean and standard deviation of the action; see `RegressionModel.predict`."""
        scaled = self._scaled(inputs)
        logs, means = [], []
        for part in self._components:
            away = scaled - part.mean_x
            logs.append(part.log_weight - 0.5 * ((away @ part.whitening.T) ** 2).sum(axis=1))
            means.append(part.mean_y + away @ part.gain.T)
        # In logs, because far from all components every density underflows to 0.
        share = np.exp(np.array(logs) - logsumexp(logs, axis=0))[..., np.newaxis]
        mean = (share * np.array(means)).sum(axis=0)
        within = np.array([part.variance for part in self._components])[:, np.newaxis]
        variance = (share * (within + (np.array(means) - mean) ** 2)).sum(axis=0)
        return self.output_scale_m * mean, self.output_scale_m * np.sqrt(variance)


def fit(training: TrainingSet, progress: Progress = ignore_progress) -> GmrModel:
    """Fit the mixture with the least Bayesian information criterion (Schwarz 1978)."""
    scales = training.layout.scales()

    def join(inputs: FloatArray, targets: FloatArray) -> FloatArray:
        return np.hstack([inputs / scales, targets / OUTPUT_SCALE_M])

    def model_of(mixture: GaussianMixture, heldout_rmse_m: tuple[float, ...] | None = None) -> GmrModel:
        return GmrModel(
            **training.shared("scikit-learn"),
            input_scale=scales,
            output_scale_m=OUTPUT_SCALE_M,
            weights=mixture.weights_,
            means=mixture.means_,
            covariances=mixture.covariances_,
            heldout_rmse_m=heldout_rmse_m,
        )

    def refit(inputs: FloatArray, targets: FloatArray) -> Predict:
        rest = model_of(fit_mixture(join(inputs, targets), best.n_components, training.seed))
        return lambda queries: rest.predict(queries)[0]

    joint = join(training.inputs, training.targets)
    most = min(MAX_COMPONENTS, max(1, len(joint) // POINTS_PER_COMPONENT))
    tried: list[tuple[float, GaussianMixture]] = []
    for components in range(1, most + 1):
        mixture = fit_mixture(joint, components, training.seed)
        tried.append((float(mixture.bic(joint)), mixture))
        progress(components, most, f"{components} components: criterion {tried[-1][0]:.0f}")
    _, best = min(tried, key=lambda pair: pair[0])
    return model_of(best, held_out_rmse(training, refit))


def fit_mixture(joint: FloatArray, components: int, seed: int) -> GaussianMixture:
    """Return the likeliest mixture of so many components over rows (N, D + A), by expectation maximisation."""
    from sklearn.exceptions import ConvergenceWarning  # imported here because a rollout does not need it
    from sklearn.mixture import GaussianMixture

    options = {"reg_covar": REGULARISATION, "n_init": STARTS, "max_iter": MAX_ITERATIONS}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # identical steps make fewer clusters than asked for
        return GaussianMixture(components, random_state=seed, **options).fit(joint)
