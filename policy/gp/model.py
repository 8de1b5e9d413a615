"""GpModel: independent Gaussian processes as numbers, which predict without the library that trained them.

Thesis, Eq. 4-5 with a prior mean of zero and the squared-exponential kernel of Eq. 4-6, one process per output:

    mean = k(x*, X) alpha            alpha = (K + noise I)^-1 y
    var  = variance - |F k(X, x*)|^2 + noise

where F is the inverse of the lower factor of K + noise I. Because the prior mean is zero, a prediction fades to "stay
where you are" far from the demonstrations (chapter 4-2-2), and its variance rises to the prior's.

F is computed once, so that a step of the closed loop needs two products and no solve. (K + noise I)^-1 itself, which
GPy keeps, would not be cheaper and loses the small deviations near the demonstrations to rounding, because its
condition number is the square of F's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg.blas import dtrmv
from scipy.linalg.lapack import dtrtri

from layflat.data.arrays import FloatArray
from layflat.policy.base import PolicyError
from layflat.policy.gp.kernel import Hyperparameters, cholesky
from layflat.policy.trained_model import RegressionModel, freeze

_HYPERPARAMETERS = ("length_scales", "variance", "noise")


@dataclass(frozen=True, kw_only=True, eq=False)
class GpModel(RegressionModel):
    """Gaussian processes over D inputs, one for each of A outputs."""

    FORMAT = "layflat-gp"
    ARRAYS = ("inputs", "input_scale", "alpha", *_HYPERPARAMETERS)
    OPTIONAL = ("inner",)
    SETTINGS: ClassVar[Mapping[str, type]] = {"output_scale_m": float, "kernel": str}

    inputs: FloatArray
    """(N, D) points in natural units (m, unit vector, portion); in the sparse form the M inducing points."""
    alpha: FloatArray
    """(A, N) weights of Eq. 4-5, in units of output_scale_m."""
    output_scale_m: float
    """Unit of the processes' outputs, m per step."""
    hyper: Hyperparameters
    inner: FloatArray | None = None
    """(A, M, M) L_B of the sparse form, see `layflat.policy.gp.sparse`; None if every step is a point."""

    def __post_init__(self) -> None:
        outputs, inputs = len(self.outputs), self.layout.size
        freeze(self, "inputs", (None, inputs))
        freeze(self, "alpha", (outputs, len(self.inputs)))
        if self.inner is not None:
            freeze(self, "inner", (outputs, len(self.inputs), len(self.inputs)))
            if not (np.diagonal(self.inner, axis1=1, axis2=2) > 0).all():
                raise PolicyError("inner is not a lower factor: its diagonal must be above 0")
        if self.hyper.length_scales.shape != (outputs, inputs):
            raise PolicyError(f"length_scales has shape {self.hyper.length_scales.shape}, not {(outputs, inputs)}")
        self._require_positive("output_scale_m")
        super().__post_init__()

    def arrays(self) -> dict[str, FloatArray]:
        """Return the arrays for a file, by name."""
        own = {name: getattr(self.hyper if name in _HYPERPARAMETERS else self, name) for name in self.ARRAYS}
        return own if self.inner is None else own | {"inner": self.inner}

    def settings(self) -> dict[str, Any]:
        """Return the header fields of this method alone."""
        return {"output_scale_m": float(self.output_scale_m), "kernel": self.hyper.kernel}

    @classmethod
    def from_arrays(cls, shared: Mapping[str, Any], arrays: Mapping[str, Any], settings: Mapping[str, Any]) -> GpModel:
        """Make a model from its shared fields and what `arrays` and `settings` returned."""
        hyper = Hyperparameters(kernel=settings["kernel"], **{name: arrays[name] for name in _HYPERPARAMETERS})
        own = {name: array for name, array in arrays.items() if name not in _HYPERPARAMETERS}
        return cls(**shared, **own, hyper=hyper, output_scale_m=settings["output_scale_m"])

    @property
    def point_name(self) -> str:
        """Name of the parts that ``n_points`` counts."""
        return "points" if self.inner is None else "inducing points, a sparse process,"

    @property
    def prior_std(self) -> FloatArray:
        """(A,) m: limit of the standard deviation of a prediction far from the demonstrations."""
        return self.output_scale_m * np.sqrt(self.hyper.variance + self.hyper.noise)

    def predict(self, inputs: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Predict mean and standard deviation; the latter includes the demonstrator's noise, as in GPy's ``predict``.

        See `RegressionModel.predict`.
        """
        scaled = self._scaled(inputs)
        mean, variance = self._predict_one(scaled[0]) if len(scaled) == 1 else self._predict_many(scaled)
        # On top of a point, rounding may take the variance of the process a little below 0.
        std = np.sqrt(np.maximum(variance, 0.0) + self.hyper.noise)
        return self.output_scale_m * mean.reshape(std.shape), self.output_scale_m * std

    @cached_property
    def _columns(self) -> FloatArray:
        """(D, N) scaled points, one input after the other."""
        return np.ascontiguousarray((self.inputs / self.input_scale).T)

    @cached_property
    def _factors(self) -> tuple[Sequence[FloatArray], Sequence[FloatArray] | None]:
        """F of each output: |F k|^2 is the variance that the points remove; of the sparse form also what it adds."""
        scaled, outputs = self.inputs / self.input_scale, range(len(self.alpha))
        noise = self.inner is None
        known = [_inverse_of_lower(cholesky(scaled, self.hyper, a, noise=noise)) for a in outputs]
        if self.inner is None:
            return known, None
        return known, [np.asfortranarray(np.tril(_inverse_of_lower(self.inner[a]) @ known[a])) for a in outputs]

    def _predict_one(self, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (A,) mean and (1, A) variance of the processes at one point (D,): a step of a closed loop."""
        cross, (known, unknown) = self._cross(point), self._factors
        variance = self.hyper.variance - _squared_norms(known, cross)
        if unknown is not None:
            variance += _squared_norms(unknown, cross)
        return np.einsum("an,an->a", self.alpha, cross), variance[np.newaxis]

    def _predict_many(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (M, A) mean and variance of the processes at points (M, D): a picture of the field."""
        cross = np.array([self._cross(point) for point in points]).transpose(1, 2, 0)
        known, unknown = self._factors
        variance = self.hyper.variance - _squared_norms_at_many(known, cross)
        if unknown is not None:
            variance += _squared_norms_at_many(unknown, cross)
        return np.einsum("an,anm->ma", self.alpha, cross), variance

    def _cross(self, point: FloatArray) -> FloatArray:
        """Return (A, N) Eq. 4-6 between the points and one more; all outputs share the squares."""
        away = self._columns - point[:, np.newaxis]
        return self.hyper.variance[:, np.newaxis] * np.exp(-0.5 / self.hyper.length_scales**2 @ (away * away))


def _inverse_of_lower(factor: FloatArray) -> FloatArray:
    """Return the inverse of a lower factor (N, N), zeros above its diagonal, in column order for BLAS."""
    inverse, _ = dtrtri(factor, lower=1)
    return np.asfortranarray(np.tril(inverse))


def _squared_norms(factors: Sequence[FloatArray], cross: FloatArray) -> FloatArray:
    """Return (A,) |F k|^2 of each output for kernels (A, N)."""
    products = [dtrmv(factor, row, lower=1) for factor, row in zip(factors, cross, strict=True)]
    return np.array([product @ product for product in products])


def _squared_norms_at_many(factors: Sequence[FloatArray], cross: FloatArray) -> FloatArray:
    """Return (M, A) |F k|^2 of each output for kernels (A, N, M)."""
    return np.array([((factor @ rows) ** 2).sum(axis=0) for factor, rows in zip(factors, cross, strict=True)]).T
