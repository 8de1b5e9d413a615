"""What many rows amount to: means, ranges and bootstrapped confidence intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import bootstrap

from layflat.app.support.metrics import COLUMNS
from layflat.data.arrays import FloatArray

BOOTSTRAP_SEED = 0
BOOTSTRAP_RESAMPLES = 9999
BATCH_VALUES = 1_000_000
"""Values that are drawn at a time, so that memory does not grow with their number."""
GROUP = ("policy", "robot", "cloth", "disturbance")


def summary(rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """One line per policy, robot, cloth and disturbance: n, and statistics of the final contact, the gain and the area.

    ``gain`` is contact_final - contact_disturbed; its columns are NaN for groups that were not disturbed.
    """
    frame = pd.DataFrame(list(rows), columns=list(COLUMNS))
    frame["gain"] = frame["contact_final"].astype(float) - frame["contact_disturbed"].astype(float)
    lines = []
    for key, group in frame.groupby(list(GROUP), sort=False):
        line: dict[str, Any] = dict(zip(GROUP, key, strict=True)) | {"n": len(group)}
        for column in ("contact_final", "gain", "flat_area_final"):
            for name, value in statistics(group[column].dropna().to_numpy(float)).items():
                line[f"{column}_{name}"] = value
        line["unstable"] = int(group["unstable"].sum())
        lines.append(line)
    return pd.DataFrame(lines)


def statistics(values: FloatArray) -> dict[str, float]:
    """mean, min, max and the 95 % confidence interval of the mean (low, high); NaN where there is nothing to say."""
    if len(values) == 0:
        return dict.fromkeys(("mean", "min", "max", "low", "high"), float("nan"))
    low, high = confidence_interval(values)
    return {
        "mean": float(values.mean()),
        "min": float(values.min()),
        "max": float(values.max()),
        "low": low,
        "high": high,
    }


def confidence_interval(values: FloatArray) -> tuple[float, float]:
    """95 % percentile bootstrap interval of the mean, seeded; (NaN, NaN) for fewer than two values.

    The percentile method, for the others divide by a spread that may be zero here (contact portions of exactly 1).
    """
    if len(values) < 2:
        return float("nan"), float("nan")
    result = bootstrap(
        (np.asarray(values, dtype=np.float64),),
        np.mean,
        confidence_level=0.95,
        n_resamples=BOOTSTRAP_RESAMPLES,
        batch=max(1, BATCH_VALUES // len(values)),
        method="percentile",
        random_state=np.random.default_rng(BOOTSTRAP_SEED),  # named rng from SciPy 1.15; Python 3.10 has 1.12
    )
    return float(result.confidence_interval.low), float(result.confidence_interval.high)
