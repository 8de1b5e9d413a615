"""A trained set of independent Gaussian processes, as numbers: predicts without the library that trained it.

Thesis, Eq. 4-5 with a prior mean of zero and the squared-exponential kernel of Eq. 4-6, one process per output:

    mean = k(x*, X) alpha            alpha = (K + noise I)^-1 y
    var  = variance - k(x*, X) (K + noise I)^-1 k(X, x*) + noise

The prior mean of zero is what makes a prediction fade to "stay where you are" far from the demonstrations (chapter
4-2-2), and the variance rise to the prior's.
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


@dataclass(frozen=True, kw_only=True, eq=False)
class GpModel(RegressionModel):
    """All that is needed to predict and to roll out; immutable, arrays read-only."""

    FORMAT: ClassVar[str] = "layflat-gp"
    ARRAYS: ClassVar[tuple[str, ...]] = ("inputs", "input_scale", "alpha", "length_scales", "variance", "noise")
    OPTIONAL: ClassVar[tuple[str, ...]] = ("inner",)
    SETTINGS: ClassVar[Mapping[str, type]] = {"output_scale_m": float, "kernel": str}

    inputs: FloatArray
    """(N, D) in natural units: m, unit vector, portion; of the sparse form the M inducing points."""
    input_scale: FloatArray
    """(D,) what each column is divided by before the kernel."""
    alpha: FloatArray
    """(A, N) weights of Eq. 4-5, in units of output_scale_m."""
    output_scale_m: float
    """What 1 means in the processes' outputs, in m per step."""
    hyper: Hyperparameters
    inner: FloatArray | None = None
    """(A, M, M) L_B of the sparse form, see ``gp_sparse``; None: each step is a point of its own."""

    def __post_init__(self) -> None:
        outputs = self.layout.robot.size
        freeze(self, "inputs", (None, self.layout.size))
        freeze(self, "input_scale", (self.layout.size,))
        freeze(self, "alpha", (outputs, len(self.inputs)))
        if self.inner is not None:
            freeze(self, "inner", (outputs, len(self.inputs), len(self.inputs)))
            if not (np.diagonal(self.inner, axis1=1, axis2=2) > 0).all():
                raise PolicyError("inner is no lower factor: its diagonal must be above 0")
        if self.hyper.length_scales.shape != (outputs, self.layout.size):
            shape = self.hyper.length_scales.shape
            raise PolicyError(f"length_scales has shape {shape}; it must be {(outputs, self.layout.size)}")
        if not len(self.inputs):
            raise PolicyError("a model needs at least one point")
        if not (self.input_scale > 0).all():
            raise PolicyError(f"input_scale holds {self.input_scale.min():g}; all must be above 0")
        self._above_zero("output_scale_m")
        super().__post_init__()

    def arrays(self) -> dict[str, FloatArray]:
        own = {name: getattr(self, name) for name in ("inputs", "input_scale", "alpha")}
        own |= {name: getattr(self.hyper, name) for name in ("length_scales", "variance", "noise")}
        return own if self.inner is None else own | {"inner": self.inner}

    def settings(self) -> dict[str, Any]:
        return {"output_scale_m": float(self.output_scale_m), "kernel": self.hyper.kernel}

    @classmethod
    def restored(cls, shared: Mapping[str, Any], arrays: Mapping[str, Any], settings: Mapping[str, Any]) -> GpModel:
        known = {name: arrays[name] for name in ("length_scales", "variance", "noise")}
        hyper = Hyperparameters(kernel=settings["kernel"], **known)
        rest = {name: array for name, array in arrays.items() if name not in known}
        return cls(**shared, **rest, hyper=hyper, output_scale_m=settings["output_scale_m"])

    @property
    def points(self) -> int:
        return len(self.inputs)

    @property
    def made_of(self) -> str:
        return "points" if self.inner is None else "inducing points, a sparse process,"

    @property
    def prior_std(self) -> FloatArray:
        """(A,) m: what the standard deviation of a prediction tends to far from the demonstrations."""
        return self.output_scale_m * np.sqrt(self.hyper.variance + self.hyper.noise)

    @cached_property
    def _cached(self) -> PredictionCache:
        """Rebuilt where it is needed, never stored."""
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
        """Mean and standard deviation, (M, A) each, in m per step, for (M, D) inputs in natural units.

        The deviation includes the noise: it is that of what the demonstrator would do, as GPy's ``predict`` has it.
        """
        mean, std = self._cached.predict(self._queries(inputs) / self.input_scale)
        return self.output_scale_m * mean, self.output_scale_m * std
