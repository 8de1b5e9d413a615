"""Statistics of samples: means, ranges and confidence intervals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binomtest, bootstrap

from layflat.data.arrays import FloatArray

CONFIDENCE = 0.95
BOOTSTRAP_SEED = 0
BOOTSTRAP_RESAMPLES = 9999
BATCH_VALUES = 1_000_000
"""Values drawn at a time, so that memory does not grow with the size of the sample."""


@dataclass(frozen=True, kw_only=True)
class SampleStatistics:
    """Mean, range and 95 % confidence interval of the mean; NaN where the sample is too small to have one."""

    n: int
    mean: float = float("nan")
    min: float = float("nan")
    max: float = float("nan")
    low: float = float("nan")
    high: float = float("nan")

    def to_json(self) -> dict[str, Any]:
        """Return n, mean, min, max and ci95 [low, high], with None for NaN."""
        mean, least, most, low, high = (
            None if np.isnan(value) else value for value in (self.mean, self.min, self.max, self.low, self.high)
        )
        return {"n": self.n, "mean": mean, "min": least, "max": most, "ci95": [low, high]}


def describe(values: FloatArray) -> SampleStatistics:
    """Return the statistics of a sample without NaN."""
    if not len(values):
        return SampleStatistics(n=0)
    low, high = confidence_interval(values)
    return SampleStatistics(
        n=len(values),
        mean=float(values.mean()),
        min=float(values.min()),
        max=float(values.max()),
        low=low,
        high=high,
    )


def confidence_interval(values: FloatArray) -> tuple[float, float]:
    """Return the 95 % percentile bootstrap interval of the mean, seeded; (NaN, NaN) for fewer than two values.

    The other bootstrap methods divide by a spread that may be zero here (contact portions of exactly 1).
    """
    if len(values) < 2:
        return float("nan"), float("nan")
    result = bootstrap(
        (np.asarray(values, dtype=np.float64),),
        np.mean,
        confidence_level=CONFIDENCE,
        n_resamples=BOOTSTRAP_RESAMPLES,
        batch=max(1, BATCH_VALUES // len(values)),
        method="percentile",
        random_state=np.random.default_rng(BOOTSTRAP_SEED),  # named rng from SciPy 1.15; Python 3.10 has 1.12
    )
    return float(result.confidence_interval.low), float(result.confidence_interval.high)


def wilson_interval(successes: int, n: int) -> tuple[float, float]:
    """Return the 95 % Wilson interval of a share."""
    interval = binomtest(successes, n).proportion_ci(confidence_level=CONFIDENCE, method="wilson")
    return float(interval.low), float(interval.high)
