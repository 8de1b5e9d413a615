"""Numbers at the head of an evaluation's page: undisturbed and disturbed episodes apart, and each place apart."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from layflat.app.evaluation.paired import CONDITION
from layflat.app.evaluation.summary import with_measures
from layflat.app.report.blocks import Card
from layflat.app.report.policies import policies_of
from layflat.app.report.table_cells import values
from layflat.app.support.formatting import interval, percent, points
from layflat.app.support.statistics import describe

UNDISTURBED = "none"
PLACE = [name for name in CONDITION if name != "disturbance"]
MAX_CARDS = 12


def headline_cards(rows: pd.DataFrame) -> tuple[Card, ...]:
    """Return a card for each policy in each place, as long as there are few."""
    varied = [name for name in PLACE if rows[name].nunique() > 1]
    cards = []
    for key, part in rows.groupby(PLACE, sort=False):
        where = "".join(f", {value}" for name, value in zip(PLACE, key, strict=True) if name in varied)
        for policy in policies_of(part):
            numbers = tuple(_numbers(with_measures(part[part["policy"] == policy])))
            if numbers:
                cards.append(Card(name=f"{policy}{where}", values=numbers))
    return tuple(cards) if len(cards) <= MAX_CARDS else ()


def _numbers(rows: pd.DataFrame) -> Iterator[tuple[str, str, str]]:
    undisturbed = rows["disturbance"] == UNDISTURBED
    for name, part in (("undisturbed", rows[undisturbed]), ("disturbed", rows[~undisturbed])):
        final, gain = describe(values(part, "contact_final")), values(part, "gain")
        if final.n:
            ends = f"[{interval(final.low, final.high)}], " if final.n > 1 else ""
            regained = f"; regained {points(gain.mean())} points" if len(gain) else ""
            yield f"{name}: final contact, mean", percent(final.mean), f"{ends}n = {final.n}{regained}"
