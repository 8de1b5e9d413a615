"""Cells and judgements that the experiments share."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd

from layflat.app.evaluation.paired import LEAST, NO_PAIRS, PairedComparison
from layflat.app.evaluation.summary import wilson, with_measures
from layflat.app.report.blocks import Block, TableBlock
from layflat.app.report.comparison_sentences import compared
from layflat.app.report.tables import interval, percent, points, ratio
from layflat.app.reproduce.studies import DISTURBANCE
from layflat.app.support.statistics import confidence_interval, statistics
from layflat.data.arrays import FloatArray

YES, NO, PART, UNKNOWN, FEW = "yes", "no", "in part", "not run", "too few to say"
END_HEADER = ("mesh", "flat area (min)", "flat at the end", "lost")
"""Of end_cells."""


def values(rows: pd.DataFrame, column: str, policy: str | None = None) -> FloatArray:
    """The known values of a column, of one policy where it is named."""
    if not len(rows) or column not in rows:
        return np.zeros(0)
    mine = rows if policy is None else rows[rows["policy"] == policy]
    return mine[column].dropna().to_numpy(float)


def enough(found: FloatArray) -> str | None:
    """Why nothing can be said about a claim; None where enough episodes were run."""
    return UNKNOWN if not len(found) else FEW if len(found) < LEAST else None


def enough_pairs(pair: PairedComparison) -> str | None:
    """As enough, of paired differences."""
    return UNKNOWN if not pair.n else FEW if pair.n < LEAST else None


def by_share(same: int, of: int) -> str:
    """Of a claim about what happens, from the episodes in which it does."""
    return YES if same >= 0.9 * of else PART if same >= 0.5 * of else NO


def by_value(stated: float, found: FloatArray) -> str:
    """Of a claim about a mean: in part where it lies in the range only."""
    low, high = confidence_interval(found)
    return YES if low <= stated <= high else PART if found.min() <= stated <= found.max() else NO


def undisturbed(rows: pd.DataFrame) -> pd.DataFrame:
    return rows[rows["disturbance"] == "none"] if len(rows) else rows


def disturbed(rows: pd.DataFrame, disturbance: str = DISTURBANCE) -> pd.DataFrame:
    return rows[rows["disturbance"] == disturbance] if len(rows) else rows


def mean_cell(found: FloatArray) -> str:
    """Mean of contact portions, with its 95 % interval where there are several."""
    numbers = statistics(found)
    ends = f" [{interval(numbers['low'], numbers['high'], '.1f')}]" if len(found) > 1 else ""
    return percent(numbers["mean"]) + ends


def contact_sentence(found: FloatArray) -> str:
    """n, mean with its interval, and range, for a claim's cell."""
    if not len(found):
        return UNKNOWN
    ends = f", {range_cell(found).replace(', ', ' to ')}" if len(found) > 1 else ""
    return f"{mean_cell(found)}{ends}, n = {len(found)}"


def gain_cell(found: FloatArray) -> str:
    """Mean of differences in points, with its 95 % interval."""
    numbers = statistics(found)
    ends = f" [{interval(numbers['low'], numbers['high'], '+.1f')}]" if len(found) > 1 else ""
    return points(numbers["mean"]) + ends


def range_cell(found: FloatArray) -> str:
    """Least and greatest contact portion of several."""
    return f"{percent(float(found.min()))}, {percent(float(found.max()))}" if len(found) > 1 else "\u2013"


def area_cell(found: FloatArray) -> str:
    """Mean flat area and the least."""
    return f"{ratio(float(found.mean()))} ({ratio(float(found.min()))})" if len(found) else "\u2013"


def flat_cell(rows: pd.DataFrame) -> str:
    """Episodes that end flat, with the Wilson interval of their share."""
    if not len(rows):
        return "\u2013"
    flat = int(with_measures(rows)["success"].sum())
    low, high = wilson(flat, len(rows))
    return f"{flat} of {len(rows)} [{interval(low, high, '.0f')} %]"


def lost_cell(rows: pd.DataFrame) -> str:
    """Episodes that diverged or crashed."""
    return str(int((rows["crashed"].astype(bool) | rows["unstable"].fillna(False).astype(bool)).sum()))


def end_cells(rows: pd.DataFrame) -> tuple[str, ...]:
    """How a controller's or policy's episodes ended, beside what the camera says of it."""
    return (
        percent(statistics(values(rows, "contact_final_true"))["mean"]),
        area_cell(values(rows, "flat_area_final")),
        flat_cell(rows),
        lost_cell(rows),
    )


def difference(rows: pd.DataFrame, a: str, b: str, column: str) -> PairedComparison:
    """a - b over the same starts; a column that is already there (gain of several disturbances) is used as it is."""
    if not len(rows) or (column != "gain" and column not in rows):
        return NO_PAIRS
    return compared(rows, a, b, column)


def difference_cell(found: PairedComparison) -> str:
    if not found.n:
        return "\u2013"
    ends = "" if math.isnan(found.low) else f" [{interval(found.low, found.high, '+.1f')}]"
    return f"{points(found.mean)} points{ends}, n = {found.n}"


def first_note(blocks: Sequence[Block], note: str) -> str:
    """The note below the first table of several alike, and none below the others."""
    return "" if any(isinstance(block, TableBlock) for block in blocks) else note
