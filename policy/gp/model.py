"""GpModel: independent Gaussian processes as numbers, which predict without the library that trained them.

Thesis, Eq. 4-5 with a prior mean of zero and the squared-exponential kernel of Eq. 4-6, one process per output:

    mean = k(x*, X) alpha            alpha = (K + noise I)^-1 y
    var  = variance - k(x*, X) (K + noise I)^-1 k(X, x*) + noise

Because the prior mean is zero, a prediction fades to "stay where you are" far from the demonstrations (chapter 4-2-2),
and its variance rises to the prior's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from layflat.data.arrays import FloatArray
from layflat.policy.base import PolicyError
from layflat.policy.gp.kernel import Hyperparameters, cholesky, kernel_factor
from layflat.policy.gp.prediction_cache import PredictionCache, inverse_of_lower, lower_product
from layflat.policy.trained_model import RegressionModel, freeze

_HYPERPARAMETERS = ("length_scales", "variance", "noise")


@dataclass(frozen=True, kw_only=True, eq=False)
class GpModel(RegressionModel):
    """Gaussian processes over D inputs, one for each of A outputs."""

    FORMAT: ClassVar[str] = "layflat-gp"
    ARRAYS: ClassVar[tuple[str, ...]] = ("inputs", "input_scale", "alpha", *_HYPERPARAMETERS)
    OPTIONAL: ClassVar[tuple[str, ...]] = ("inner",)
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
        if not len(self.inputs):
            raise PolicyError("a model needs at least one point")
        self._require_positive("output_scale_m")
        super().__post_init__()

    def arrays(self) -> dict[str, FloatArray]:
        """Return the arrays for a file, by name."""
        own = {name: getattr(self, name) for name in ("inputs", "input_scale", "alpha")}
        own |= {name: getattr(self.hyper, name) for name in _HYPERPARAMETERS}
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
    def n_points(self) -> int:
        """Number of points, or of inducing points."""
        return len(self.inputs)

    @property
    def point_name(self) -> str:
        """Name of the parts that ``n_points`` counts."""
        return "points" if self.inner is None else "inducing points, a sparse process,"

    @property
    def prior_std(self) -> FloatArray:
        """(A,) m: limit of the standard deviation of a prediction far from the demonstrations."""
        return self.output_scale_m * np.sqrt(self.hyper.variance + self.hyper.noise)

    @cached_property
    def _cache(self) -> PredictionCache:
        """Factors for predictions; computed on first use, never stored in a file."""
        scaled, outputs = self.inputs / self.input_scale, range(len(self.alpha))
        if self.inner is None:
            known, unknown = [inverse_of_lower(cholesky(scaled, self.hyper, a)) for a in outputs], None
        else:
            known = [inverse_of_lower(kernel_factor(scaled, self.hyper, a)) for a in outputs]
            unknown = [lower_product(inverse_of_lower(self.inner[a]), known[a]) for a in outputs]
        return PredictionCache(
            columns=np.ascontiguousarray(scaled.T),
            rates=-0.5 / self.hyper.length_scales**2,
            variance=self.hyper.variance,
            noise=self.hyper.noise,
            alpha=self.alpha,
            known=known,
            unknown=unknown,
        )

    def predict(self, inputs: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Predict mean and standard deviation; the latter includes the demonstrator's noise, as in GPy's ``predict``.

        See `RegressionModel.predict`.
        """
        mean, std = self._cache.predict(self._scaled(inputs))
        return self.output_scale_m * mean, self.output_scale_m * std
