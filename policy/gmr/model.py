"""GmrModel: a mixture of Gaussians over inputs and outputs, conditioned on the inputs.

Gaussian mixture regression (Ghahramani and Jordan 1994; Calinon, Guenter and Billard 2007). With component k of weight
w_k, mean (m_x, m_y) and covariance ((S_xx, S_xy), (S_yx, S_yy)), all in scaled units:

    h_k(x)  = w_k N(x; m_x, S_xx) / sum over the components
    m_k(x)  = m_y + S_yx S_xx^-1 (x - m_x)
    S_k     = S_yy - S_yx S_xx^-1 S_xy
    mean    = sum h_k m_k
    var     = sum h_k (diag S_k + m_k^2) - mean^2

Unlike a Gaussian process it does not fade: far from the data it follows the plane of the nearest component.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import LinAlgError, cholesky, solve_triangular
from scipy.special import logsumexp

from layflat.data.arrays import FloatArray
from layflat.policy.base import PolicyError
from layflat.policy.trained_model import RegressionModel, freeze

SUM_TOLERANCE = 1e-6


@dataclass(frozen=True, kw_only=True)
class _Conditional:
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

    FORMAT: ClassVar[str] = "layflat-gmr"
    ARRAYS: ClassVar[tuple[str, ...]] = ("input_scale", "weights", "means", "covariances")
    SETTINGS: ClassVar[Mapping[str, type]] = {"output_scale_m": float}

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

    @property
    def n_points(self) -> int:
        """Number of components."""
        return len(self.weights)

    @property
    def point_name(self) -> str:
        """Name of the parts that ``n_points`` counts."""
        return "components"

    @cached_property
    def _components(self) -> tuple[_Conditional, ...]:
        return tuple(
            self._conditional(*parts) for parts in zip(self.weights, self.means, self.covariances, strict=True)
        )

    def _conditional(self, weight: float, mean: FloatArray, covariance: FloatArray) -> _Conditional:
        d = self.layout.size
        try:
            factor = cholesky(covariance, lower=True)
        except LinAlgError as error:
            raise PolicyError("a covariance is not positive: it cannot be conditioned on") from error
        # The factor's own blocks, without any difference: S_yx S_xx^-1 = L_yx L_xx^-1 and S_k = L_yy L_yy^T.
        whitening = solve_triangular(factor[:d, :d], np.eye(d), lower=True)
        return _Conditional(
            log_weight=float(np.log(weight) - np.log(np.diag(factor)[:d]).sum() - 0.5 * d * np.log(2 * np.pi)),
            mean_x=mean[:d],
            mean_y=mean[d:],
            whitening=whitening,
            gain=factor[d:, :d] @ whitening,
            variance=(factor[d:, d:] ** 2).sum(axis=1),
        )

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
