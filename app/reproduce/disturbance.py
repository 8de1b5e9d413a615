"""Figures 4-4, 4-5, 4-9 and 4-10, Table 4-2: what the policies do about a disturbance, on two cloths, twice."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from layflat.app.report import thesis_numbers as thesis
from layflat.app.report.blocks import Block, TableBlock, Text
from layflat.app.report.comparison_sentences import difference_sentence
from layflat.app.report.result_tables import policies_of
from layflat.app.report.tables import Table, percent, points
from layflat.app.report.thesis_numbers import BASELINE, PROPOSED
from layflat.app.reproduce.experiment_results import MISSING, Claim, ExperimentOutput, ExperimentResults
from layflat.app.reproduce.studies import DISTURBANCE, Trial, placing, second_cloth
from layflat.app.reproduce.table_cells import (
    NO,
    PART,
    UNKNOWN,
    YES,
    difference,
    disturbed,
    enough,
    first_note,
    flat_cell,
    gain_cell,
    lost_cell,
    mean_cell,
    range_cell,
    values,
)
from layflat.app.support.statistics import confidence_interval
from layflat.data.arrays import FloatArray

HEADER = (
    "",
    "n",
    "after placing",
    "after disturbance (min,\u00a0max)",
    "final",
    "regained, points [95\u00a0%\u00a0CI]",
    "mesh at the end",
    "flat at the end",
    "lost",
)
TURNS = ("first", "second")
NOTE = (
    "As Table 4-2: contact portion from the camera; the thesis's three experiments each, then the means over all of "
    "our starts, with the final numbers of "
    "the repair that follows each disturbance. \u201cRegained\u201d is the contact after the repair less that after "
    "the disturbance. The second disturbance comes "
    "after the first repair has ended, as in the thesis's 7th frame."
)


def show(material: ExperimentResults) -> ExperimentOutput:
    """For each cloth and robot a table, what differs, curves, and a strip of each policy."""
    blocks: list[Block] = []
    claims: list[Claim] = []
    for trial in (*placing(material.size), *second_cloth(material.size)):
        rows = disturbed(material.rows(trial))
        claims += _claims(trial, rows)
        if not len(rows):
            blocks.append(Text(lines=(f"{trial.robot}, {trial.cloth}: {MISSING}",)))
            continue
        title = f"{trial.robot} robot, {trial.cloth}, taught on the same cloth"
        blocks.append(TableBlock(table=disturbance_table(rows), title=title, note=first_note(blocks, NOTE)))
        lines = [
            difference_sentence(PROPOSED, BASELINE, column, difference(rows, PROPOSED, BASELINE, column))
            for column in ("regained_1", "regained_2", "flat_area_final")
            if column in rows
        ]
        blocks.append(Text(lines=tuple(lines), finding=True))
        blocks.append(material.curves(trial, rows))
        for policy in policies_of(rows):
            blocks += material.strips(trial, policy, DISTURBANCE)
    return ExperimentOutput(blocks=tuple(blocks), claims=tuple(claims))


def disturbance_table(rows: pd.DataFrame, *, beside: bool = True) -> Table:
    """Table 4-2 with ours below the thesis's, a line for each disturbance in turn; or ours alone."""
    lines: list[tuple[str, ...]] = []
    for policy in policies_of(rows):
        for number, cells in enumerate(thesis.DISTURBANCE.get(policy, ()) if beside else (), start=1):
            gained = points(cells[2] - cells[1])
            lines.append((f"{policy}, thesis {number}", "1", *map(percent, cells), gained, "", "", ""))
        lines += _lines(policy, rows[rows["policy"] == policy])
    return Table(HEADER, tuple(lines), tuple("thesis" not in line[0] for line in lines))


def _lines(policy: str, rows: pd.DataFrame) -> Iterator[tuple[str, ...]]:
    rounds = [k for k in (1, 2) if len(values(rows, f"disturbed_{k}"))]
    for k in rounds:
        after, gained = values(rows, f"disturbed_{k}"), values(rows, f"regained_{k}")
        last = k == rounds[-1]
        before = rows["contact_placed"] if k == 1 else rows[f"disturbed_{k - 1}"] + rows[f"regained_{k - 1}"]
        name = policy if len(rounds) == 1 else f"{policy}, {TURNS[k - 1]} disturbance"
        yield (
            name,
            str(len(after)),
            mean_cell(before.dropna().to_numpy(float)),
            f"{percent(float(after.mean()))} ({range_cell(after)})",
            mean_cell(after + gained),
            gain_cell(gained),
            percent(float(values(rows, "contact_final_true").mean())) if last else "",
            flat_cell(rows) if last else "",
            lost_cell(rows) if last else "",
        )


def _claims(trial: Trial, rows: pd.DataFrame) -> Iterator[Claim]:
    where = f"{trial.robot}, {trial.cloth}"
    for policy, stated in thesis.REGAINED_CLAIM.items():
        theirs = thesis.regained(policy)
        for k, turn in enumerate(TURNS[: max(trial.repeats, 1)], start=1):
            found = values(rows, f"regained_{k}", policy)
            yield Claim(
                what=f"{policy} regains after the {turn} disturbance ({where})",
                source=f"chapter 4-3-3, {thesis.DISTURBANCE_SOURCE}",
                thesis=f"{stated} ({points(min(theirs))} to {points(max(theirs))})",
                ours=f"{gain_cell(found)}, n = {len(found)}" if len(found) else UNKNOWN,
                holds=enough(found) or (_nothing(found) if policy == BASELINE else _five_or_more(found)),
            )
    found = values(rows, "contact_final", PROPOSED)
    left = int((found < 0.99).sum())
    yield Claim(
        what=f"{PROPOSED} does not remove every wrinkle ({where})",
        source="chapters 4-2-3, 4-3-3, 5-1",
        thesis="88.99 to 95.32 % at the end",
        ours=f"{mean_cell(found)}; {left} of {len(found)} below 99 %" if len(found) else UNKNOWN,
        holds=enough(found) or (YES if left >= 0.9 * len(found) else PART if left > 0.1 * len(found) else NO),
    )


def _nothing(found: FloatArray) -> str:
    low, high = confidence_interval(found)
    return YES if max(-low, high) < 0.01 else PART if abs(found.mean()) < 0.01 else NO


def _five_or_more(found: FloatArray) -> str:
    low, _ = confidence_interval(found)
    if low > 0.10:
        return f"{YES}, and more"
    return YES if low >= 0.05 else PART if found.mean() >= 0.05 else NO
