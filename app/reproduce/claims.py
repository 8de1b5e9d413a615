"""Claims of the thesis, and the rules by which our numbers agree with them."""

from __future__ import annotations

from dataclasses import dataclass

from layflat.app.evaluation.paired import MIN_PAIRS, PairedComparison
from layflat.app.report.table_cells import mean_cell, range_cell
from layflat.app.support.statistics import confidence_interval
from layflat.data.arrays import FloatArray

YES, NO, PART, UNKNOWN, FEW = "yes", "no", "in part", "not run", "too few to say"


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A statement of the thesis beside our result."""

    what: str
    source: str
    thesis: str
    ours: str
    agrees: str
    """YES, NO, PART, or why nothing can be said."""


def too_few(sample: FloatArray | PairedComparison) -> str | None:
    """Return why nothing can be said about a claim; None where enough episodes or pairs were run."""
    n = sample.n if isinstance(sample, PairedComparison) else len(sample)
    return UNKNOWN if not n else FEW if n < MIN_PAIRS else None


def agrees_by_share(n_same: int, n: int) -> str:
    """Judge a claim about what happens by the number of episodes in which it does."""
    return YES if n_same >= 0.9 * n else PART if n_same >= 0.5 * n else NO


def agrees_by_value(stated: float, found: FloatArray) -> str:
    """Judge a claim about a mean: in part where it lies in the range of our values only."""
    low, high = confidence_interval(found)
    return YES if low <= stated <= high else PART if found.min() <= stated <= found.max() else NO


def contact_sentence(found: FloatArray) -> str:
    """Return mean with interval, range and n of contact portions."""
    if not len(found):
        return UNKNOWN
    ends = f", {range_cell(found).replace(', ', ' to ')}" if len(found) > 1 else ""
    return f"{mean_cell(found)}{ends}, n = {len(found)}"
