"""The thesis's Tables 4-1 and 4-2 with ours beside them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np
import pandas as pd

from layflat.app.report import thesis_numbers as thesis
from layflat.app.report.blocks import Table
from layflat.app.report.policies import policies_of
from layflat.app.report.table_cells import (
    END_HEADER,
    end_cells,
    flat_cell,
    gain_cell,
    lost_cell,
    mean_cell,
    range_cell,
    values,
)
from layflat.app.support.formatting import interval, percent, points
from layflat.app.support.phases import DisturbanceOutcome
from layflat.app.support.statistics import describe

PLACING_HEADER = ("", "n", "max", "mean", "min", "95\u00a0%\u00a0CI of mean", *END_HEADER)
PLACING_NOTE = (
    "As Table 4-1: contact portion at the end of placing, from the camera (Eq. 4-7). The thesis's numbers are of its "
    "robot; it does not say how many runs they summarise. Mesh contact is the share of the cloth's area that rests on "
    "the table. Flat at the end: flat area above 0.97, with the 95 % Wilson interval."
)
DISTURBANCE_HEADER = (
    "", "n", "after placing", "after disturbance (min,\u00a0max)", "final", "regained, points [95\u00a0%\u00a0CI]",
    "mesh at the end", "flat at the end", "lost",
)  # fmt: skip
DISTURBANCE_NOTE = (
    "As Table 4-2: contact portion from the camera; the thesis's three experiments each, then the means over all of "
    "our starts, with the final numbers of the repair that follows each disturbance. \u201cRegained\u201d is the "
    "contact after the repair less that after the disturbance. The second disturbance comes after the first repair "
    "has ended, as in the thesis's 7th frame."
)
TURNS = ("first", "second")


def with_outcomes(rows: pd.DataFrame, outcomes_of: Callable[[str], Iterable[DisturbanceOutcome]]) -> pd.DataFrame:
    """Add ``disturbed_K`` and ``regained_K`` of the K-th disturbance (from 1); ``outcomes_of`` takes a run's name.

    ``contact_disturbed`` and ``gain`` become means over an episode's disturbances, so that it counts once however
    often it was disturbed; NaN without one. Crashed episodes have no outcomes.
    """
    lines = []
    for line in rows.to_dict(orient="records"):
        line["gain"] = float("nan")
        outcomes = () if line["crashed"] else tuple(outcomes_of(line["run"]))
        if outcomes:
            line["gain"] = float(np.mean([outcome.regained for outcome in outcomes]))
            line["contact_disturbed"] = float(np.mean([outcome.disturbed for outcome in outcomes]))
        for k, outcome in enumerate(outcomes, start=1):
            line |= {f"disturbed_{k}": outcome.disturbed, f"regained_{k}": outcome.regained}
        lines.append(line)
    return pd.DataFrame(lines)


def placing_table(rows: pd.DataFrame, *, cite: bool = True) -> Table:
    """Make Table 4-1; ``cite`` puts the thesis's rows above ours."""
    lines: list[tuple[str, ...]] = []
    cited = set()
    for policy in policies_of(rows):
        if cite and policy in thesis.PLACING:
            cited.add(len(lines))
            lines.append((f"{policy}, thesis", "", *map(percent, thesis.PLACING[policy]), *[""] * 5))
        mine = rows[rows["policy"] == policy]
        contact = describe(values(mine, "contact_final"))
        numbers = (*map(percent, (contact.max, contact.mean, contact.min)), interval(contact.low, contact.high))
        lines.append((policy, str(len(mine)), *numbers, *end_cells(mine)))
    return Table(PLACING_HEADER, tuple(lines), frozenset(cited))


def disturbance_table(rows: pd.DataFrame, *, cite: bool = True) -> Table:
    """Make Table 4-2 from rows with_outcomes, a line for each disturbance in turn."""
    lines: list[tuple[str, ...]] = []
    cited = set()
    for policy in policies_of(rows):
        for number, cells in enumerate(thesis.DISTURBANCE.get(policy, ()) if cite else (), start=1):
            cited.add(len(lines))
            gain = points(cells[2] - cells[1])
            lines.append((f"{policy}, thesis {number}", "1", *map(percent, cells), gain, "", "", ""))
        lines += _disturbance_lines(policy, rows[rows["policy"] == policy])
    return Table(DISTURBANCE_HEADER, tuple(lines), frozenset(cited))


def _disturbance_lines(policy: str, rows: pd.DataFrame) -> Iterator[tuple[str, ...]]:
    turns = [k for k in (1, 2) if len(values(rows, f"disturbed_{k}"))]
    for k in turns:
        disturbed, gain = values(rows, f"disturbed_{k}"), values(rows, f"regained_{k}")
        before = rows["contact_placed"] if k == 1 else rows[f"disturbed_{k - 1}"] + rows[f"regained_{k - 1}"]
        mesh = percent(describe(values(rows, "contact_final_true")).mean)
        yield (
            policy if len(turns) == 1 else f"{policy}, {TURNS[k - 1]} disturbance",
            str(len(disturbed)),
            mean_cell(before.dropna().to_numpy(float)),
            f"{percent(disturbed.mean())} ({range_cell(disturbed)})",
            mean_cell(disturbed + gain),
            gain_cell(gain),
            *((mesh, flat_cell(rows), lost_cell(rows)) if k == turns[-1] else ("", "", "")),
        )
