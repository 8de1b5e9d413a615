"""A trained set of independent Gaussian processes, as numbers: predicts without the library that trained it.

Thesis, Eq. 4-5 with a prior mean of zero and the squared-exponential kernel of Eq. 4-6, one process per output:

    mean = k(x*, X) alpha            alpha = (K + noise I)^-1 y
    var  = variance - k(x*, X) (K + noise I)^-1 k(X, x*) + noise

The prior mean of zero is what makes a prediction fade to "stay where you are" far from the demonstrations (chapter
4-2-2), and the variance rise to the prior's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import LinAlgError, cho_factor, cho_solve, solve_triangular
from scipy.spatial.distance import cdist

from data.types import FloatArray, action_size
from policy.base import PolicyError
from policy.learned import Field, freeze

KERNELS = ("se", "se-ard")
"""Squared exponential with one length scale for all inputs (Eq. 4-6), or with one for each."""

JITTER = 1e-8
"""Added to the noise variance wherever a kernel matrix is factorised, as GPy does, so that both agree to the digit."""


@dataclass(frozen=True, kw_only=True)
class Hyperparameters:
    """Of A independent processes over D inputs; inputs in units of their scale, outputs in units of theirs."""

    kernel: str
    length_scales: FloatArray
    """(A, D); all columns of a row are equal under kernel ``se``."""
    variance: FloatArray
    """(A,) of the process."""
    noise: FloatArray
    """(A,) variance of the demonstrator around the process."""

    def __post_init__(self) -> None:
        freeze(self, "length_scales", (None, None))
        outputs = len(self.length_scales)
        freeze(self, "variance", (outputs,))
        freeze(self, "noise", (outputs,))
        if self.kernel not in KERNELS:
            raise PolicyError(f"kernel is {self.kernel!r}; it must be one of {', '.join(KERNELS)}")
        for name in ("length_scales", "variance", "noise"):
            if not (getattr(self, name) > 0).all():
                raise PolicyError(f"{name} holds {getattr(self, name).min():g}; all must be above 0")
        if self.kernel == "se" and not (self.length_scales == self.length_scales[:, :1]).all():
            raise PolicyError("kernel se has one length scale for all inputs, but they differ")


@dataclass(frozen=True, kw_only=True, eq=False)
class GpModel(Field):
    """All that is needed to predict and to roll out; immutable, arrays read-only."""

    FORMAT: ClassVar[str] = "layflat-gp"
    ARRAYS: ClassVar[tuple[str, ...]] = ("inputs", "input_scale", "alpha", "length_scales", "variance", "noise")
    SETTINGS: ClassVar[Mapping[str, type]] = {"output_scale_m": float, "kernel": str}

    inputs: FloatArray
    """(N, D) in natural units: m, unit vector, portion."""
    input_scale: FloatArray
    """(D,) what each column is divided by before the kernel."""
    alpha: FloatArray
    """(A, N) weights of Eq. 4-5, in units of output_scale_m."""
    output_scale_m: float
    """What 1 means in the processes' outputs, in m per tick."""
    hyper: Hyperparameters

    def __post_init__(self) -> None:
        outputs = action_size(self.layout.task)
        freeze(self, "inputs", (None, self.layout.size))
        freeze(self, "input_scale", (self.layout.size,))
        freeze(self, "alpha", (outputs, len(self.inputs)))
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
        return own | {name: getattr(self.hyper, name) for name in ("length_scales", "variance", "noise")}

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
    def prior_std(self) -> FloatArray:
        """(A,) m: what the standard deviation of a prediction tends to far from the demonstrations."""
        return self.output_scale_m * np.sqrt(self.hyper.variance + self.hyper.noise)

    @cached_property
    def _chol(self) -> tuple[FloatArray, ...]:
        """A times (N, N), lower; rebuilt, never stored."""
        scaled = self.inputs / self.input_scale
        return tuple(cholesky(scaled, self.hyper, a) for a in range(len(self.alpha)))

    def predict(self, inputs: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation, (M, A) each, in m per tick, for (M, D) inputs in natural units.

        The deviation includes the noise: it is that of what the demonstrator would do, as GPy's ``predict`` has it.
        """
        queries = self._queries(inputs)
        scaled, points = queries / self.input_scale, self.inputs / self.input_scale
        mean = np.empty((len(queries), len(self.alpha)))
        variance = np.empty_like(mean)
        for a, (alpha, chol) in enumerate(zip(self.alpha, self._chol, strict=True)):
            cross = covariance(points, scaled, self.hyper, a)
            mean[:, a] = alpha @ cross
            whitened = solve_triangular(chol, cross, lower=True, check_finite=False)
            variance[:, a] = self.hyper.variance[a] - np.einsum("nm,nm->m", whitened, whitened)
        # Rounding may take the variance of the process a hair below 0 on top of a point.
        std = np.sqrt(np.maximum(variance, 0.0) + self.hyper.noise)
        return self.output_scale_m * mean, self.output_scale_m * std


def covariance(left: FloatArray, right: FloatArray, hyper: Hyperparameters, output: int) -> FloatArray:
    """(N, M) Eq. 4-6 of one output between scaled inputs (N, D) and (M, D)."""
    length = hyper.length_scales[output]
    squared = cdist(left / length, right / length, "sqeuclidean")
    return np.asarray(hyper.variance[output] * np.exp(-0.5 * squared))


def cholesky(scaled: FloatArray, hyper: Hyperparameters, output: int) -> FloatArray:
    """(N, N) lower factor of K + noise I over scaled inputs (N, D)."""
    kernel = covariance(scaled, scaled, hyper, output)
    kernel[np.diag_indices_from(kernel)] += hyper.noise[output] + JITTER
    try:
        factor, _ = cho_factor(kernel, lower=True, overwrite_a=True, check_finite=False)
    except LinAlgError as error:
        raise PolicyError(f"the kernel matrix of output {output} is not positive: the noise is too small") from error
    return np.asarray(factor)


def weights(scaled: FloatArray, targets: FloatArray, hyper: Hyperparameters) -> FloatArray:
    """(A, N) alpha of Eq. 4-5 for scaled inputs (N, D) and scaled targets (N, A)."""
    columns = range(targets.shape[1])
    return np.array([cho_solve((cholesky(scaled, hyper, a), True), targets[:, a]) for a in columns])


def held_out_errors(
    scaled: FloatArray, targets: FloatArray, groups: Sequence[int] | np.ndarray, hyper: Hyperparameters
) -> FloatArray:
    """(N, A) target minus what a model without the target's own group predicts; hyperparameters stay as they are.

    With P = (K + noise I)^-1 the error on group b is (P_bb)^-1 (P y)_b (Rasmussen and Williams, section 5.4.2, for
    blocks), so that no model has to be trained again. One group alone gives the targets: nothing is left to learn from.
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
