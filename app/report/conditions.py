"""Section of a page on conditions that were drawn: results against each drawn quantity."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from layflat.app.evaluation.summary import with_measures
from layflat.app.report.blocks import Section, Table, TableBlock
from layflat.app.report.charts import Scatter, scatters_with_means
from layflat.app.report.policies import policies_of
from layflat.app.report.table_cells import flat_cell, lost_cell, mean_cell, values
from layflat.sim.conditions.keys import Key, keys

MIN_BIN, MAX_BINS = 4, 4
"""Episodes of a policy from which a bin of a drawn number is made, and most bins."""
HEADER = ("condition", "value", "policy", "n", "final contact [95\u00a0%\u00a0CI]", "flat at the end", "lost")


def drawn_keys(rows: pd.DataFrame) -> list[str]:
    """Return the conditions that differ between episodes, in the order of the keys."""
    if "conditions" not in rows:
        return []
    return [name for name in keys() if len({given.get(name, keys()[name].default) for given in rows["conditions"]}) > 1]


def conditions_section(rows: pd.DataFrame) -> Section | None:
    """Return the results against each drawn quantity; None where nothing was drawn."""
    found = drawn_keys(rows)
    if not found:
        return None
    panels, lines = {}, []
    for name in found:
        key = keys()[name]
        drawn = rows.assign(drawn=[given.get(name, key.default) for given in rows["conditions"]])
        binned = drawn.assign(bin=bins(drawn["drawn"]))
        panels[f"{name} ({key.unit})" if key.unit else name] = _scatter(key, binned)
        lines += [(name, *line) for line in _lines(binned)]
    note = (
        "Every policy meets the same draw with the same seed. Dots are episodes; lines join the means of bins with "
        "equal numbers of them, with 95 % bootstrap intervals. Crashed episodes are in the table only."
    )
    figure = scatters_with_means(panels, caption=note)
    table = TableBlock(table=Table(HEADER, tuple(lines)), title="Results by what was drawn", folded=True)
    return Section(id="conditions", title="Against what was drawn", short="Conditions", blocks=(figure, table))


def bins(drawn: pd.Series) -> pd.Series:
    """Return the label of each value's bin: its own where few different ones were drawn, else a range."""
    if drawn.dtype == object or drawn.nunique() <= MAX_BINS:
        return drawn.map(str)
    count = int(np.clip(drawn.nunique() // MIN_BIN, 1, MAX_BINS))
    cut = pd.qcut(drawn.astype(float), count, duplicates="drop")
    return cut.map(lambda part: f"{part.left:.3g} to {part.right:.3g}").astype(str)


def _parts(rows: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    order = rows.sort_values("drawn", key=lambda column: column.map(_rank))
    for label in dict.fromkeys(order["bin"]):
        yield label, rows[rows["bin"] == label]


def _rank(value: Any) -> Any:
    return value if isinstance(value, str) else float(value)


def _lines(rows: pd.DataFrame) -> Iterator[tuple[str, ...]]:
    for label, part in _parts(rows):
        for policy in policies_of(rows):
            mine = with_measures(part[part["policy"] == policy])
            contact = mean_cell(values(mine, "contact_final"))
            yield label, policy, str(len(mine)), contact, flat_cell(mine), lost_cell(mine)


def _scatter(key: Key, rows: pd.DataFrame) -> Scatter:
    known = rows[rows["contact_final"].notna()]
    words = [name for name in key.choices if name in set(known["drawn"])]
    placed = known.assign(x=known["drawn"].map(words.index if words else float).astype(float))
    by_policy = {policy: placed[placed["policy"] == policy] for policy in policies_of(rows)}
    return Scatter(
        {policy: mine[["x", "contact_final"]].to_numpy(float) for policy, mine in by_policy.items()},
        {
            policy: [(float(part["x"].mean()), values(part, "contact_final")) for _, part in _parts(mine)]
            for policy, mine in by_policy.items()
        },
        words,
    )
