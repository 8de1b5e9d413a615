"""Kernel of Eq. 4-6 and the quantities that follow from it: matrices, factors, weights and held-out errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.spatial.distance import cdist

from layflat.data.arrays import FloatArray
from layflat.policy.base import PolicyError
from layflat.policy.trained_model import freeze

KERNELS = ("se", "se-ard")
"""Squared exponential with one length scale for all inputs (Eq. 4-6), or with one for each input."""

JITTER = 1e-8
"""Added to the noise variance whenever a kernel matrix is factorised, as in GPy, so that both agree to the digit."""


@dataclass(frozen=True, kw_only=True)
class Hyperparameters:
    """Hyperparameters of A independent processes over D inputs, in scaled units."""

    kernel: str
    """One of KERNELS."""
    length_scales: FloatArray
    """(A, D); under the kernel ``se`` all columns of a row are equal."""
    variance: FloatArray
    """(A,) variance of the process."""
    noise: FloatArray
    """(A,) variance of the demonstrator around the process."""

    def __post_init__(self) -> None:
        freeze(self, "length_scales", (None, None))
        for name in ("variance", "noise"):
            freeze(self, name, (len(self.length_scales),))
        if self.kernel not in KERNELS:
            raise PolicyError(f"kernel is {self.kernel!r}; it must be one of {', '.join(KERNELS)}")
        for name in ("length_scales", "variance", "noise"):
            if not (getattr(self, name) > 0).all():
                raise PolicyError(f"{name} holds {getattr(self, name).min():g}; all must be above 0")
        if self.kernel == "se" and not (self.length_scales == self.length_scales[:, :1]).all():
            raise PolicyError("kernel se has one length scale for all inputs, but they differ")


def covariance(left: FloatArray, right: FloatArray, hyper: Hyperparameters, output: int) -> FloatArray:
    """Return Eq. 4-6 of one output, (N, M), between scaled inputs (N, D) and (M, D)."""
    length = hyper.length_scales[output]
    squared = cdist(left / length, right / length, "sqeuclidean")
    return np.asarray(hyper.variance[output] * np.exp(-0.5 * squared))


def cholesky(scaled: FloatArray, hyper: Hyperparameters, output: int, *, noise: bool = True) -> FloatArray:
    """Return the lower factor (N, N) of K + noise I over scaled inputs (N, D); without ``noise`` that of K alone."""
    kernel = covariance(scaled, scaled, hyper, output)
    kernel[np.diag_indices_from(kernel)] += (float(hyper.noise[output]) if noise else 0.0) + JITTER
    try:
        factor, _ = cho_factor(kernel, lower=True, overwrite_a=True, check_finite=False)
    except LinAlgError as error:
        why = "the noise is too small" if noise else "the inducing points are too close to each other"
        raise PolicyError(f"the kernel matrix of output {output} is not positive: {why}") from error
    return np.asarray(np.tril(factor))


def weights(scaled: FloatArray, targets: FloatArray, hyper: Hyperparameters) -> FloatArray:
    """Return alpha of Eq. 4-5, (A, N), for scaled inputs (N, D) and scaled targets (N, A)."""
    columns = range(targets.shape[1])
    return np.array([cho_solve((cholesky(scaled, hyper, a), True), targets[:, a]) for a in columns])


def held_out_errors(
    scaled: FloatArray, targets: FloatArray, groups: Sequence[int] | np.ndarray, hyper: Hyperparameters
) -> FloatArray:
    """Return (N, A) targets minus the predictions of a model trained without each target's own group.

    With P = (K + noise I)^-1 the error on group b is (P_bb)^-1 (P y)_b (Rasmussen and Williams, section 5.4.2, for
    blocks), so that nothing is trained again. With a single group the errors are the targets.
    """
    labels = np.asarray(groups)
    errors = np.empty_like(targets)
    for a in range(targets.shape[1]):
        precision = cho_solve((cholesky(scaled, hyper, a), True), np.eye(len(scaled)))
        alpha = precision @ targets[:, a]
        for label in np.unique(labels):
            rows = np.flatnonzero(labels == label)
            errors[rows, a] = np.linalg.solve(precision[np.ix_(rows, rows)], alpha[rows])
    return errors
