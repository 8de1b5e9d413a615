"""A trained set of independent Gaussian processes, as numbers: predicts without the library that trained it.

Thesis, Eq. 4-5 with a prior mean of zero and the squared-exponential kernel of Eq. 4-6, one process per output:

    mean = k(x*, X) alpha            alpha = (K + noise I)^-1 y
    var  = variance - k(x*, X) (K + noise I)^-1 k(X, x*) + noise

The prior mean of zero is what makes a prediction fade to "stay where you are" far from the demonstrations (chapter
4-2-2), and the variance rise to the prior's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import LinAlgError, cho_factor, cho_solve, solve_triangular
from scipy.spatial.distance import cdist

from data.types import ACTION_LIMIT_M, ACTION_NAMES, TICK_S, FloatArray, Provenance, action_size, frozen_array
from perception.descriptors import DEFAULT, DESCRIPTORS
from policy.base import PolicyError
from policy.features import FeatureLayout

KERNELS = ("se", "se-ard")
"""Squared exponential with one length scale for all inputs (Eq. 4-6), or with one for each."""

JITTER = 1e-8
"""Added to the noise variance wherever a kernel matrix is factorised, as GPy does, so that both agree to the digit."""

STOP_THRESHOLD_M = 0.003
STOP_TICKS = 8
"""Norm of the output below which, and ticks for which, a policy has finished (chapter 4-2-3 gives no number)."""


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
        _freeze(self, "length_scales", (None, None))
        outputs = len(self.length_scales)
        _freeze(self, "variance", (outputs,))
        _freeze(self, "noise", (outputs,))
        if self.kernel not in KERNELS:
            raise PolicyError(f"kernel is {self.kernel!r}; it must be one of {', '.join(KERNELS)}")
        for name in ("length_scales", "variance", "noise"):
            if not (getattr(self, name) > 0).all():
                raise PolicyError(f"{name} holds {getattr(self, name).min():g}; all must be above 0")
        if self.kernel == "se" and not (self.length_scales == self.length_scales[:, :1]).all():
            raise PolicyError("kernel se has one length scale for all inputs, but they differ")


@dataclass(frozen=True, kw_only=True, eq=False)
class GpModel:
    """All that is needed to predict and to roll out; immutable, arrays read-only."""

    policy: str
    """Name of the policy that it makes, gp-word or gp-baseline."""
    layout: FeatureLayout
    cloth: str
    """Cloth of the demonstrations."""
    descriptor: str = DEFAULT
    """What the observations' WORD was and is to be taken from."""
    inputs: FloatArray
    """(N, D) in natural units: m, unit vector, portion."""
    input_scale: FloatArray
    """(D,) what each column is divided by before the kernel."""
    alpha: FloatArray
    """(A, N) weights of Eq. 4-5, in units of output_scale_m."""
    output_scale_m: float
    """What 1 means in the processes' outputs, in m per tick."""
    hyper: Hyperparameters
    tick_s: float = TICK_S
    action_limit_m: float = ACTION_LIMIT_M
    stop_threshold_m: float = STOP_THRESHOLD_M
    stop_ticks: int = STOP_TICKS
    seed: int = 0
    demonstrations: int = 1
    points_available: int = 0
    """Ticks of the demonstrations before thinning to N."""
    heldout_rmse_m: tuple[float, ...] | None = None
    """(A,) m per tick, error on a demonstration by a model without it; None where there was only one."""
    provenance: Provenance = field(default_factory=Provenance)

    def __post_init__(self) -> None:
        outputs = action_size(self.layout.task)
        _freeze(self, "inputs", (None, self.layout.size))
        _freeze(self, "input_scale", (self.layout.size,))
        _freeze(self, "alpha", (outputs, len(self.inputs)))
        if self.hyper.length_scales.shape != (outputs, self.layout.size):
            shape = self.hyper.length_scales.shape
            raise PolicyError(f"length_scales has shape {shape}; it must be {(outputs, self.layout.size)}")
        if not len(self.inputs):
            raise PolicyError("a model needs at least one point")
        if not (self.input_scale > 0).all():
            raise PolicyError(f"input_scale holds {self.input_scale.min():g}; all must be above 0")
        if self.heldout_rmse_m is not None:
            object.__setattr__(self, "heldout_rmse_m", tuple(float(v) for v in self.heldout_rmse_m))
            if len(self.heldout_rmse_m) != outputs:
                raise PolicyError(f"heldout_rmse_m has {len(self.heldout_rmse_m)} values; it must have {outputs}")
        self._check_numbers()

    def _check_numbers(self) -> None:
        for name in ("output_scale_m", "tick_s", "stop_threshold_m", "stop_ticks", "demonstrations"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise PolicyError(f"{name} is {value}; it must be above 0")
        if not 0 < self.action_limit_m <= ACTION_LIMIT_M:
            raise PolicyError(f"action_limit_m is {self.action_limit_m}; it must be in 0..{ACTION_LIMIT_M}")
        if not (self.policy and self.cloth):
            raise PolicyError("a model must name its policy and its cloth")
        if self.descriptor not in DESCRIPTORS:
            raise PolicyError(f"descriptor is {self.descriptor!r}; it must be one of {', '.join(DESCRIPTORS)}")

    @property
    def points(self) -> int:
        return len(self.inputs)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the A outputs."""
        return ACTION_NAMES[self.layout.task]

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
        queries = np.asarray(inputs, dtype=np.float64)
        if queries.ndim != 2 or queries.shape[1] != self.layout.size:
            raise PolicyError(f"inputs have shape {queries.shape}; they must be (M, {self.layout.size})")
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


def _freeze(instance: object, name: str, shape: tuple[int | None, ...]) -> None:
    """Replace an array field by a checked, read-only copy."""
    try:
        object.__setattr__(instance, name, frozen_array(getattr(instance, name), shape, name))
    except ValueError as error:
        raise PolicyError(str(error)) from error
