"""Comparison of two policies over the same starts and disturbances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd

from layflat.app.support.statistics import SampleStatistics, describe
from layflat.data.arrays import FloatArray

CONDITION = ("robot", "task", "cloth", "physics", "disturbance")
"""Columns within which policies are compared."""
PAIR = (*CONDITION, "seed")
"""Columns that two paired episodes share."""
MIN_PAIRS = 6
"""Pairs below which nothing is concluded: five that all point the same way do so by chance in one of 16."""
TIE = 5e-4
"""Contact portions nearer than this count as the same: a twentieth of a point."""


@dataclass(frozen=True, kw_only=True)
class PairedComparison(SampleStatistics):
    """Statistics of the differences a - b over n pairs, in the unit of the column."""

    n_higher: int = 0
    """Pairs in which a is higher than b."""
    n_lower: int = 0

    @property
    def is_significant(self) -> bool:
        """Whether there are enough pairs and the interval excludes 0."""
        return self.n >= MIN_PAIRS and bool(self.low > 0 or self.high < 0)


NO_PAIRS = PairedComparison(n=0)


def paired_differences(a: pd.DataFrame, b: pd.DataFrame, column: str, *, on: Sequence[str] = PAIR) -> FloatArray:
    """Return ``column`` of ``a`` less that of ``b`` where both have the same ``on`` and a value."""
    both = a.merge(b, on=list(on), suffixes=("_a", "_b"))
    return (both[f"{column}_a"].astype(float) - both[f"{column}_b"].astype(float)).dropna().to_numpy(float)


def compare_paired(a: pd.DataFrame, b: pd.DataFrame, column: str) -> PairedComparison:
    """Compare ``column`` of ``a`` with that of ``b`` over the pairs that have both values."""
    differences = paired_differences(a, b, column)
    n_higher, n_lower = int((differences > TIE).sum()), int((differences < -TIE).sum())
    return PairedComparison(**vars(describe(differences)), n_higher=n_higher, n_lower=n_lower)
