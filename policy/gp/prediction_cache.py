"""PredictionCache: factors that are computed once, so that a step of the closed loop needs two products and no solve.

For each output it keeps the inverse F of the lower factor of K + noise I. With k = k(X, x*)

    mean = alpha^T k        var = variance - |F k|^2 + noise

F is as large as K, but only half of it is read, once per step: with some hundred points memory is the limit, not
arithmetic. (K + noise I)^-1 itself, which GPy keeps, would not be cheaper and loses the small deviations near the
demonstrations to rounding, because its condition number is the square of F's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg.blas import dtrmv
from scipy.linalg.lapack import dtrtri

from layflat.data.arrays import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictionCache:
    """Factors for A outputs, N points and D inputs, all in scaled units."""

    columns: FloatArray
    """(D, N) points, one input after the other."""
    rates: FloatArray
    """(A, D) -1 / (2 l^2)."""
    variance: FloatArray
    """(A,)"""
    noise: FloatArray
    """(A,)"""
    alpha: FloatArray
    """(A, N)"""
    known: Sequence[FloatArray]
    """A lower factors F (N, N): |F k|^2 is the variance that the points remove."""
    unknown: Sequence[FloatArray] | None = None
    """A lower factors F (N, N) of the sparse form: |F k|^2 is the variance that the inducing points add back."""

    def predict(self, scaled: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation, (M, A) each, for scaled inputs (M, D)."""
        if len(scaled) == 1:
            mean, variance = self._predict_one(scaled[0])
            mean, variance = mean[np.newaxis], variance[np.newaxis]
        else:
            mean, variance = self._predict_many(scaled)
        # On top of a point, rounding may take the variance of the process a little below 0.
        return mean, np.sqrt(np.maximum(variance, 0.0) + self.noise)

    def _predict_one(self, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (A,) mean and variance of the processes at one point (D,): a step of a closed loop."""
        cross = self._cross(point)
        variance = self.variance - _squared_norms(self.known, cross)
        if self.unknown is not None:
            variance += _squared_norms(self.unknown, cross)
        return np.einsum("an,an->a", self.alpha, cross), variance

    def _predict_many(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (M, A) mean and variance of the processes at points (M, D): a picture of the field."""
        cross = np.array([self._cross(point) for point in points]).transpose(1, 2, 0)
        mean = np.einsum("an,anm->ma", self.alpha, cross)
        variance = self.variance - _squared_norms_at_many(self.known, cross)
        if self.unknown is not None:
            variance += _squared_norms_at_many(self.unknown, cross)
        return mean, variance

    def _cross(self, point: FloatArray) -> FloatArray:
        """Return (A, N) Eq. 4-6 between the points and one more; all outputs share the squares."""
        away = self.columns - point[:, np.newaxis]
        return self.variance[:, np.newaxis] * np.exp(self.rates @ (away * away))


def inverse_of_lower(factor: FloatArray) -> FloatArray:
    """Return the inverse of a lower factor (N, N), zeros above its diagonal, in column order for BLAS."""
    inverse, _ = dtrtri(factor, lower=1)
    return np.asfortranarray(np.tril(inverse))


def lower_product(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return the product of two lower factors (N, N), itself a lower factor."""
    return np.asfortranarray(np.tril(left @ right))


def _squared_norms(factors: Sequence[FloatArray], cross: FloatArray) -> FloatArray:
    """Return (A,) |F k|^2 of each output for kernels (A, N)."""
    products = [dtrmv(factor, row, lower=1) for factor, row in zip(factors, cross, strict=True)]
    return np.array([product @ product for product in products])


def _squared_norms_at_many(factors: Sequence[FloatArray], cross: FloatArray) -> FloatArray:
    """Return (M, A) |F k|^2 of each output for kernels (A, N, M)."""
    return np.array([((factor @ rows) ** 2).sum(axis=0) for factor, rows in zip(factors, cross, strict=True)]).T
