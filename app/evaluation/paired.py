"""Comparison of two policies over the same starts and disturbances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd

from layflat.app.support.statistics import confidence_interval

PAIR = ("robot", "cloth", "seed", "disturbance")
"""What two episodes share that are compared."""
LEAST = 6
"""Pairs below which nothing is said: five that all point the same way do so by chance in one of 16."""
TIE = 5e-4
"""Contact portions that are nearer than this are the same: a twentieth of a point."""


@dataclass(frozen=True, kw_only=True)
class PairedComparison:
    """Differences a - b over n pairs, in the unit of the column."""

    n: int
    mean: float
    low: float
    high: float
    """95 % bootstrap interval of the mean; NaN for fewer than two pairs."""
    better: int
    worse: int

    @property
    def is_significant(self) -> bool:
        """Whether there are enough pairs, and the interval leaves 0 out."""
        return self.n >= LEAST and bool(self.low > 0 or self.high < 0)


NO_PAIRS = PairedComparison(n=0, mean=float("nan"), low=float("nan"), high=float("nan"), better=0, worse=0)


def compare_paired(a: pd.DataFrame, b: pd.DataFrame, column: str, *, on: Sequence[str] = PAIR) -> PairedComparison:
    """``column`` of ``a`` less that of ``b`` where both have the same ``on`` and a value."""
    both = a.merge(b, on=list(on), suffixes=("_a", "_b"))
    values = (both[f"{column}_a"].astype(float) - both[f"{column}_b"].astype(float)).dropna().to_numpy(float)
    if not len(values):
        return NO_PAIRS
    low, high = confidence_interval(values)
    return PairedComparison(
        n=len(values),
        mean=float(values.mean()),
        low=low,
        high=high,
        better=int((values > TIE).sum()),
        worse=int((values < -TIE).sum()),
    )


def with_gain(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows with ``gain``: contact regained after the (last) disturbance, unless they have one; NaN without any."""
    if "gain" in rows:
        return rows
    return rows.assign(gain=rows["contact_final"].astype(float) - rows["contact_disturbed"].astype(float))
