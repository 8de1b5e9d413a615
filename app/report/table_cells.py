"""Cells of tables of episodes: means with intervals, ranges and counts of their rows."""

from __future__ import annotations

import numpy as np
import pandas as pd

from layflat.app.evaluation.paired import PairedComparison
from layflat.app.evaluation.summary import with_measures
from layflat.app.support.formatting import MISSING, interval, percent, points, ratio
from layflat.app.support.statistics import describe, wilson_interval
from layflat.data.arrays import FloatArray

END_HEADER = ("mesh", "flat area (min)", "flat at the end", "lost")
"""Columns of end_cells."""


def values(rows: pd.DataFrame, column: str, policy: str | None = None) -> FloatArray:
    """Return the known values of a column, of one policy where it is named."""
    if not len(rows) or column not in rows:
        return np.zeros(0)
    part = rows if policy is None else rows[rows["policy"] == policy]
    return part[column].dropna().to_numpy(float)


def mean_cell(shares: FloatArray) -> str:
    """Format the mean of shares, with its 95 % interval where there are several."""
    numbers = describe(shares)
    ends = f" [{interval(numbers.low, numbers.high)}]" if numbers.n > 1 else ""
    return percent(numbers.mean) + ends


def gain_cell(differences: FloatArray) -> str:
    """Format the mean of differences in points, with its 95 % interval where there are several."""
    numbers = describe(differences)
    ends = f" [{interval(numbers.low, numbers.high, '+.1f')}]" if numbers.n > 1 else ""
    return points(numbers.mean) + ends


def range_cell(shares: FloatArray) -> str:
    """Format the least and the greatest of several shares."""
    return f"{percent(shares.min())}, {percent(shares.max())}" if len(shares) > 1 else MISSING


def area_cell(ratios: FloatArray) -> str:
    """Format the mean and the least of flat areas."""
    return f"{ratio(ratios.mean())} ({ratio(ratios.min())})" if len(ratios) else MISSING


def flat_cell(rows: pd.DataFrame) -> str:
    """Count the episodes that end flat, with the Wilson interval of their share."""
    if not len(rows):
        return MISSING
    flat = int(with_measures(rows)["success"].sum())
    return f"{flat} of {len(rows)} [{interval(*wilson_interval(flat, len(rows)), '.0f')} %]"


def lost_cell(rows: pd.DataFrame) -> str:
    """Count the episodes that diverged or crashed."""
    return str(int((rows["crashed"].astype(bool) | rows["unstable"].fillna(False).astype(bool)).sum()))


def end_cells(rows: pd.DataFrame) -> tuple[str, ...]:
    """Format the ends of episodes: mesh contact, flat area, flat episodes and lost ones."""
    mesh = percent(describe(values(rows, "contact_final_true")).mean)
    return mesh, area_cell(values(rows, "flat_area_final")), flat_cell(rows), lost_cell(rows)


def difference_cell(pair: PairedComparison) -> str:
    """Format a paired difference in points, with its interval and the number of pairs."""
    if not pair.n:
        return MISSING
    ends = f" [{interval(pair.low, pair.high, '+.1f')}]" if pair.n > 1 else ""
    return f"{points(pair.mean)} points{ends}, n = {pair.n}"
