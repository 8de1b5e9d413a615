"""Fit of Gaussian processes to demonstrations; the only module that imports GPy, which a rollout does not need.

Thesis, chapter 4-1: one process per output, squared-exponential kernel (Eq. 4-6), hyperparameters by maximum
likelihood with L-BFGS. The outputs are not centred, so that the prior mean of zero means "stay where you are".
"""

from __future__ import annotations

import logging
import math
import platform
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np
from scipy.spatial.distance import cdist

from layflat.data.arrays import FloatArray
from layflat.policy.base import PolicyError
from layflat.policy.gp import sparse
from layflat.policy.gp.kernel import Hyperparameters, held_out_errors, weights
from layflat.policy.gp.model import GpModel
from layflat.policy.trained_model import Progress, ignore_progress
from layflat.policy.training_set import MIN_POINTS, OUTPUT_SCALE_M, TrainingSet

LENGTH_SCALE_BOUNDS = (0.1, 5.0)
"""In units of an input's scale: 1 cm to 50 cm of position. Above, a model would not fade on the table; below, it would
remember steps instead of learning from them."""
VARIANCE_BOUNDS = (0.01, 25.0)
"""Prior deviation of 1 mm to 50 mm a step."""
NOISE_BOUNDS = (1e-4, 0.25)
"""Deviation of 0.1 mm to 5 mm a step: no hand is more exact, and more noise would drown the slowest move."""

MAX_POINTS = 2000
"""Training costs N^3 and a step N^2; with more steps the sparse form is used, in which both cost N once."""
INDUCING_POINTS = 300
"""Points of the sparse form; on ten demonstrations (766 steps) its moves are within 1.3 % of the full form's (rms)."""
LIKELIHOOD_POINTS = 1000
"""Most steps, evenly subsampled, from which the full form learns its hyperparameters; its points are all steps."""
START_POINTS = 300
"""Most steps from which the start of the optimiser is found."""
START_LENGTH_SCALES = np.geomspace(0.15, 4.0, 14)
START_NOISE_RATIOS = np.geomspace(1e-5, 1.0, 16)
MIN_START_VARIANCE = 1e-12
"""Lower bound of the start's variance: targets that are all zero have none."""
MAX_ITERATIONS = 200
EXPECTED_TRIES = 30
"""Points that one run of the optimiser is expected to try, for the progress."""


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """Options of a fit."""

    ard: bool = False
    """One length scale for each input instead of the thesis's one for all."""
    starts: int = 1
    """Starting points of the optimiser: that of `best_start`, then random ones; the likeliest end is used."""
    max_points: int = MAX_POINTS
    """Number of steps above which the sparse form is used, with ``inducing_points`` points."""
    inducing_points: int = INDUCING_POINTS
    intervention_weight: int = 1
    """Weight of the steps in which a person corrected a policy: with 4 each counts as if it was shown four times."""

    def __post_init__(self) -> None:
        least = {"starts": 1, "max_points": MIN_POINTS, "inducing_points": MIN_POINTS, "intervention_weight": 1}
        for name, bound in least.items():
            if getattr(self, name) < bound:
                raise PolicyError(f"{name} is {getattr(self, name)}; it must be at least {bound}")


def fit(training: TrainingSet, progress: Progress = ignore_progress, *, options: FitOptions | None = None) -> GpModel:
    """Fit a model; ``progress`` is called at each try of the optimiser and after each output."""
    options, scale, seed = options or FitOptions(), training.layout.scales(), training.seed
    scaled, outputs = training.inputs / scale, training.targets / OUTPUT_SCALE_M
    is_sparse = len(scaled) > options.max_points
    inducing = sparse.inducing_points(scaled, options.inducing_points, seed) if is_sparse else None
    rows = slice(None) if is_sparse else subsample(len(scaled), LIKELIHOOD_POINTS)
    hyper = fit_hyperparameters(
        scaled[rows],
        outputs[rows],
        ard=options.ard,
        starts=options.starts,
        seed=seed,
        inducing=inducing,
        names=training.layout.robot.action_names,
        progress=progress,
    )
    # Only the predictions are weighted. For the likelihood, copies would look like a demonstrator without any noise.
    copies = np.repeat(np.arange(len(scaled)), np.where(training.corrections, options.intervention_weight, 1))
    if inducing is None:
        errors = held_out_errors(scaled, outputs, training.groups, hyper)
        points, inner, alpha = training.inputs[copies], None, weights(scaled[copies], outputs[copies], hyper)
    else:
        errors = sparse.held_out_errors(inducing, scaled, outputs, training.groups, hyper)
        points = inducing * scale
        alpha, inner = sparse.compress(inducing, scaled[copies], outputs[copies], hyper)
    single = len(np.unique(training.groups)) < 2
    return GpModel(
        **training.shared("GPy"),
        inputs=points,
        input_scale=scale,
        alpha=alpha,
        inner=inner,
        output_scale_m=OUTPUT_SCALE_M,
        hyper=hyper,
        heldout_rmse_m=None if single else tuple(OUTPUT_SCALE_M * np.sqrt((errors**2).mean(axis=0))),
    )


def fit_hyperparameters(
    inputs: FloatArray,
    targets: FloatArray,
    *,
    ard: bool = False,
    starts: int = 1,
    seed: int = 0,
    inducing: FloatArray | None = None,
    names: Sequence[str] = (),
    progress: Progress = ignore_progress,
) -> Hyperparameters:
    """Return the likeliest hyperparameters within the bounds, for scaled inputs (N, D) and targets (N, A).

    With scaled ``inducing`` points (M, D), which stay fixed, the sparse form's bound on the likelihood is maximised.
    """
    rng = np.random.default_rng(seed)
    size, outputs = inputs.shape[1], targets.shape[1]
    n_lengths = size if ard else 1
    few = subsample(len(inputs), START_POINTS)
    start = best_start(inputs[few], targets[few])
    found: list[tuple[FloatArray, float, float]] = []
    for a in range(outputs):
        length, variance, noise = (float(value[a]) for value in start)
        begins = [(np.full(n_lengths, length), _inside(variance, VARIANCE_BOUNDS), _inside(noise, NOISE_BOUNDS))]
        begins += [_random_start(rng, n_lengths) for _ in range(starts - 1)]
        name = names[a] if a < len(names) else f"output {a}"
        tries = count(1)

        def on_try(a: int = a, tries: Iterator[int] = tries, name: str = name) -> None:
            tried = min(next(tries), EXPECTED_TRIES * starts - 1)
            progress(a * EXPECTED_TRIES * starts + tried, outputs * EXPECTED_TRIES * starts, f"{name}: optimising")

        ends = [_optimise(inputs, targets[:, a : a + 1], begin, ard, inducing, on_try) for begin in begins]
        found.append(min(ends, key=lambda end: end[0])[1:])
        noise_mm = 1000 * OUTPUT_SCALE_M * math.sqrt(found[-1][2])
        parts = EXPECTED_TRIES * starts
        progress((a + 1) * parts, outputs * parts, f"{name}: noise {noise_mm:.2f} mm a step")
    return Hyperparameters(
        kernel="se-ard" if ard else "se",
        length_scales=np.array([np.broadcast_to(length, size) for length, _, _ in found]),
        variance=np.array([variance for _, variance, _ in found]),
        noise=np.array([noise for _, _, noise in found]),
    )


def best_start(inputs: FloatArray, targets: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return length scale, variance and noise, (A,) each, of the likeliest point of a grid, for scaled data.

    With K = variance (R(l) + rho I), R(l) = U S U^T, and rho the noise over the variance, the likelihood of every
    output for every rho and the best variance follow from one decomposition (N^3) for each length scale l:

        variance = sum_i (u_i^T y)^2 / (s_i + rho) / N
        -log p   = (N log variance + sum_i log(s_i + rho) + N) / 2 + constant

    On ten demonstrations with either robot, one run of the optimiser from here ended where the likelier of two runs
    from elsewhere ended.
    """
    count, outputs = targets.shape
    squared = cdist(inputs, inputs, "sqeuclidean")
    best, found = np.full(outputs, np.inf), np.ones((3, outputs))
    for length in START_LENGTH_SCALES:
        values, vectors = np.linalg.eigh(np.exp(-0.5 * squared / length**2))
        power = (vectors.T @ targets) ** 2
        for ratio in START_NOISE_RATIOS:
            spread = np.maximum(values, 0.0) + ratio
            variance = np.maximum((power / spread[:, np.newaxis]).mean(axis=0), MIN_START_VARIANCE)
            cost = 0.5 * (count * np.log(variance) + np.log(spread).sum())
            better = cost < best
            best[better] = cost[better]
            found[:, better] = np.stack([np.full(outputs, length), variance, ratio * variance])[:, better]
    length, variance, noise = found
    return length, variance, noise


def subsample(count: int, most: int) -> np.ndarray:
    """Return (min(count, most),) rows, evenly spread over ``count``, with the first and the last."""
    if count <= most:
        return np.arange(count)
    return np.linspace(0, count - 1, most).round().astype(int)


def _inside(value: float, bounds: tuple[float, float]) -> float:
    """Move ``value`` inside the bounds and off their ends, where the optimiser has no gradient to follow."""
    return min(max(value, bounds[0] * 1.1), bounds[1] / 1.1)


def _random_start(rng: np.random.Generator, n_lengths: int) -> tuple[FloatArray, float, float]:
    """Draw length scales, variance and noise, log-uniform."""

    def draw(low: float, high: float, size: int) -> FloatArray:
        return np.exp(rng.uniform(math.log(low), math.log(high), size))

    return draw(0.3, 3.0, n_lengths), float(draw(0.1, 5.0, 1)[0]), float(draw(1e-3, 0.1, 1)[0])


def _optimise(
    inputs: FloatArray,
    target: FloatArray,
    start: tuple[FloatArray, float, float],
    ard: bool,
    inducing: FloatArray | None = None,
    on_try: Callable[[], None] = lambda: None,
) -> tuple[float, FloatArray, float, float]:
    """Run L-BFGS once, calling ``on_try`` at each point.

    Returns negative log likelihood, length scales (1,) or (D,), variance and noise at its end.
    """
    gpy = import_gpy()
    length, variance, noise = start
    # A line search may try a corner of the bounds; values that overflow there are rejected anyway.
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        kernel = gpy.kern.RBF(inputs.shape[1], variance=variance, lengthscale=length, ARD=ard)
        if inducing is None:
            model = gpy.models.GPRegression(inputs, target, kernel, noise_var=noise)
        else:
            model = gpy.models.SparseGPRegression(inputs, target, kernel, Z=inducing)
            model.inducing_inputs.fix(warning=False)
            model.likelihood.variance[:] = noise
        model.kern.lengthscale.constrain_bounded(*LENGTH_SCALE_BOUNDS, warning=False)
        model.kern.variance.constrain_bounded(*VARIANCE_BOUNDS, warning=False)
        model.likelihood.variance.constrain_bounded(*NOISE_BOUNDS, warning=False)
        model.add_observer(on_try, lambda *_, **__: on_try())
        model.optimize("lbfgsb", max_iters=MAX_ITERATIONS)
    lengths = np.array(model.kern.lengthscale, dtype=np.float64)
    cost = float(model.objective_function())
    return cost, lengths, float(model.kern.variance[0]), float(model.likelihood.variance[0])


def import_gpy() -> Any:
    """Import GPy, which takes a second or two, only when it is needed; PolicyError if that fails."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import GPy
    except ImportError as error:
        # paramz 0.9.6, the last for Python 3.10, does not work with numpy 2: neither its imports nor its arrays.
        raise PolicyError(
            f"GPy cannot be imported with numpy {np.__version__} on Python {platform.python_version()} ({error}); "
            "install the versions that constraints.txt names"
        ) from error
    for name in ("GP", "paramz", "GPy"):
        logging.getLogger(name).setLevel(logging.ERROR)
    return GPy
