"""Predicting from factors that are computed once: what a step of the closed loop costs is two products and no solve.

For each output the inverse F of the lower factor of K + noise I is kept, so that with k = k(X, x*)

    mean = alpha^T k        var = variance - |F k|^2 + noise

F is as large as K, but only half of it is read, and that once a step: at some hundred points memory is the limit, not
arithmetic. (K + noise I)^-1 itself, as GPy keeps it, would be no cheaper, and loses the small deviations near the
demonstrations to rounding: its condition is the square of F's.
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
    """All in scaled units; A outputs, N points, D inputs."""

    columns: FloatArray
    """(D, N) the points, one input after the other."""
    rates: FloatArray
    """(A, D) -1 / (2 l^2)."""
    variance: FloatArray
    """(A,)"""
    noise: FloatArray
    """(A,)"""
    alpha: FloatArray
    """(A, N)"""
    known: Sequence[FloatArray]
    """A times (N, N), lower, in columns: |F k|^2 is what the points take off the variance."""
    unknown: Sequence[FloatArray] | None = None
    """Of the sparse form, the same: |F k|^2 is what the inducing points do not know of the steps, and is added back."""

    def predict(self, scaled: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation, (M, A) each, for scaled inputs (M, D)."""
        if len(scaled) == 1:
            mean, variance = self._at(scaled[0])
            mean, variance = mean[np.newaxis], variance[np.newaxis]
        else:
            mean, variance = self._on(scaled)
        # Rounding may take the variance of the process a hair below 0 on top of a point.
        return mean, np.sqrt(np.maximum(variance, 0.0) + self.noise)

    def _at(self, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(A,) mean and variance of the processes at one (D,): the step of a closed loop."""
        cross = self._cross(point)
        variance = self.variance - _squares(self.known, cross)
        if self.unknown is not None:
            variance += _squares(self.unknown, cross)
        return np.einsum("an,an->a", self.alpha, cross), variance

    def _on(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(M, A) mean and variance of the processes on many (M, D): a picture of the field."""
        cross = np.array([self._cross(point) for point in points]).transpose(1, 2, 0)
        mean = np.einsum("an,anm->ma", self.alpha, cross)
        variance = self.variance - _squares_of_all(self.known, cross)
        if self.unknown is not None:
            variance += _squares_of_all(self.unknown, cross)
        return mean, variance

    def _cross(self, point: FloatArray) -> FloatArray:
        """(A, N) Eq. 4-6 between the points and one more; the squares are shared by all outputs."""
        away = self.columns - point[:, np.newaxis]
        return self.variance[:, np.newaxis] * np.exp(self.rates @ (away * away))


def inverse_of_lower(factor: FloatArray) -> FloatArray:
    """(N, N) inverse of a lower factor, zeros above its diagonal, in the order of columns that BLAS reads fastest."""
    inverse, _ = dtrtri(factor, lower=1)
    return np.asfortranarray(np.tril(inverse))


def lower_product(left: FloatArray, right: FloatArray) -> FloatArray:
    """(N, N) product of two lower factors, itself one."""
    return np.asfortranarray(np.tril(left @ right))


def _squares(factors: Sequence[FloatArray], cross: FloatArray) -> FloatArray:
    """(A,) |F k|^2 of each output at one place."""
    moved = [dtrmv(factor, row, lower=1) for factor, row in zip(factors, cross, strict=True)]
    return np.array([row @ row for row in moved])


def _squares_of_all(factors: Sequence[FloatArray], cross: FloatArray) -> FloatArray:
    """(M, A) the same at many places, whose kernels are (A, N, M)."""
    return np.array([((factor @ rows) ** 2).sum(axis=0) for factor, rows in zip(factors, cross, strict=True)]).T
