"""What numbers say, in words that go no further than they do."""

from __future__ import annotations

import pandas as pd

from layflat.app.evaluation.paired import LEAST, PairedComparison, compare_paired, with_gain
from layflat.app.report.tables import Table, interval, points

QUANTITIES = {
    "contact_placed": ("placed", "contact after placing"),
    "gain": ("regained", "contact regained after the disturbance"),
    "regained_1": ("regained, first", "contact regained after the first disturbance"),
    "regained_2": ("regained, second", "contact regained after the second disturbance"),
    "contact_final": ("final", "final contact"),
    "contact_final_true": ("mesh", "final mesh contact"),
    "flat_area_final": ("flat area", "final flat area"),
}
"""Columns that policies are compared by, and what a table and a sentence call them; all are shares."""
PAIRED_HEADER = ("difference", "of", "n pairs", "mean (points)", "95\u00a0%\u00a0CI", "higher / lower in", "says")


def verdict(difference: PairedComparison) -> str:
    """What a paired difference shows: "higher", "lower", or that these n can show none."""
    if difference.n == 0:
        return "no pair has both values"
    if difference.n < LEAST:
        return f"{difference.n} pair{'s are' if difference.n > 1 else ' is'} too few to say"
    if difference.better == difference.worse == 0:
        return f"the same in all {difference.n} pairs"
    if not difference.is_significant:
        return f"no difference that {difference.n} pairs can show"
    return "higher" if difference.mean > 0 else "lower"


def difference_sentence(a: str, b: str, column: str, difference: PairedComparison, where: str = "") -> str:
    """One sentence on ``a`` less ``b`` in a column of QUANTITIES."""
    quantity = QUANTITIES[column][1]
    numbers = (
        f"{points(difference.mean)} points [{interval(difference.low, difference.high, '+.1f')}], n = {difference.n}"
    )
    at = f" ({where})" if where else ""
    said = verdict(difference)
    if said in ("higher", "lower"):
        return f"{quantity[0].upper()}{quantity[1:]} is {said} with {a} than with {b}{at}: {numbers}."
    if difference.n < 2:
        return f"{quantity[0].upper()}{quantity[1:]}, {a} against {b}{at}: {said}."
    if difference.n < LEAST:
        return f"{quantity[0].upper()}{quantity[1:]}, {a} less {b}{at}: {numbers}; {said}."
    return f"{quantity[0].upper()}{quantity[1:]}: {said} between {a} and {b}{at}: {numbers}."


def _short(difference: PairedComparison) -> str:
    """As verdict, for a table's cell."""
    said = verdict(difference)
    return (
        said
        if said in ("higher", "lower")
        else "the same"
        if "same" in said
        else "too few"
        if "few" in said
        else "none shown"
    )


def compared(rows: pd.DataFrame, a: str, b: str, quantity: str) -> PairedComparison:
    """The paired difference of two policies' rows in a column of QUANTITIES."""
    known = with_gain(rows) if quantity == "gain" else rows
    return compare_paired(known[known["policy"] == a], known[known["policy"] == b], quantity)


def paired_table(rows: pd.DataFrame, pairs: list[tuple[str, str]]) -> Table:
    """Every pair of policies (a, b) in every quantity that has values; a - b."""
    lines = []
    for a, b in pairs:
        for column, (word, _) in QUANTITIES.items():
            d = compared(rows, a, b, column) if column in rows or column == "gain" else None
            if d is not None and d.n:
                ends = interval(d.low, d.high, "+.1f")
                lines.append(
                    (f"{a} \u2212 {b}", word, str(d.n), points(d.mean), ends, f"{d.better} / {d.worse}", _short(d))
                )
    return Table(PAIRED_HEADER, tuple(lines), (True,) * len(lines))
