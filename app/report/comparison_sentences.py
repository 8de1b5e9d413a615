"""Conclusions from paired differences, in words that claim no more than the numbers show."""

from __future__ import annotations

import pandas as pd

from layflat.app.evaluation.paired import MIN_PAIRS, NO_PAIRS, PairedComparison, compare_paired
from layflat.app.evaluation.summary import with_measures
from layflat.app.report.blocks import Table
from layflat.app.support.formatting import interval, points

QUANTITIES = {
    "contact_placed": ("placed", "contact after placing"),
    "gain": ("regained", "contact regained after the disturbance"),
    "regained_1": ("regained, first", "contact regained after the first disturbance"),
    "regained_2": ("regained, second", "contact regained after the second disturbance"),
    "contact_final": ("final", "final contact"),
    "contact_final_true": ("mesh", "final mesh contact"),
    "flat_area_final": ("flat area", "final flat area"),
}
"""Columns that policies are compared by, all shares, and their names in a table and in a sentence."""
PAIRED_HEADER = ("difference", "of", "n pairs", "mean (points)", "95\u00a0%\u00a0CI", "higher / lower in", "says")


def compare_policies(rows: pd.DataFrame, a: str, b: str, column: str) -> PairedComparison:
    """Compare two policies' rows in a column of QUANTITIES; NO_PAIRS where the rows lack it."""
    if not len(rows) or (column != "gain" and column not in rows):
        return NO_PAIRS
    known = with_measures(rows) if column == "gain" else rows
    return compare_paired(known[known["policy"] == a], known[known["policy"] == b], column)


def verdict(pair: PairedComparison) -> str:
    """Return what a paired difference shows: "higher", "lower", or that these n cannot show one."""
    if pair.n == 0:
        return "no pair has both values"
    if pair.n < MIN_PAIRS:
        return f"{pair.n} pair{'s are' if pair.n > 1 else ' is'} too few to say"
    if pair.n_higher == pair.n_lower == 0:
        return f"the same in all {pair.n} pairs"
    if not pair.is_significant:
        return f"no difference that {pair.n} pairs can show"
    return "higher" if pair.mean > 0 else "lower"


def comparison_sentence(a: str, b: str, column: str, pair: PairedComparison, where: str = "") -> str:
    """Return one sentence on ``a`` less ``b`` in a column of QUANTITIES."""
    name = QUANTITIES[column][1]
    quantity, at = name[0].upper() + name[1:], f" ({where})" if where else ""
    numbers = f"{points(pair.mean)} points [{interval(pair.low, pair.high, '+.1f')}], n = {pair.n}"
    result = verdict(pair)
    if result in ("higher", "lower"):
        return f"{quantity} is {result} with {a} than with {b}{at}: {numbers}."
    if pair.n < 2:
        return f"{quantity}, {a} against {b}{at}: {result}."
    if pair.n < MIN_PAIRS:
        return f"{quantity}, {a} less {b}{at}: {numbers}; {result}."
    return f"{quantity}: {result} between {a} and {b}{at}: {numbers}."


def paired_table(rows: pd.DataFrame, pairs: list[tuple[str, str]]) -> Table:
    """Compare every pair of policies (a, b), a - b, in every quantity that has values."""
    lines = []
    for a, b in pairs:
        for column, (name, _) in QUANTITIES.items():
            pair = compare_policies(rows, a, b, column)
            if pair.n:
                ends, counts = interval(pair.low, pair.high, "+.1f"), f"{pair.n_higher} / {pair.n_lower}"
                cells = (str(pair.n), points(pair.mean), ends, counts, _short_verdict(pair))
                lines.append((f"{a} \u2212 {b}", name, *cells))
    return Table(PAIRED_HEADER, tuple(lines))


def _short_verdict(pair: PairedComparison) -> str:
    if pair.n < MIN_PAIRS:
        return "too few"
    result = verdict(pair)
    return result if result in ("higher", "lower") else "the same" if "same" in result else "none shown"
