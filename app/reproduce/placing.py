"""Figures 4-2 and 4-3, Table 4-1: placing with the baseline and with the proposed method."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from layflat.app.report import thesis_numbers as thesis
from layflat.app.report.blocks import Block, TableBlock, Text
from layflat.app.report.comparison_sentences import difference_sentence
from layflat.app.report.result_tables import policies_of
from layflat.app.report.tables import Table, interval, percent
from layflat.app.report.thesis_numbers import BASELINE, PROPOSED
from layflat.app.reproduce.experiment_results import MISSING, Claim, ExperimentOutput, ExperimentResults
from layflat.app.reproduce.studies import Trial, placing
from layflat.app.reproduce.table_cells import (
    END_HEADER,
    NO,
    UNKNOWN,
    YES,
    by_share,
    by_value,
    contact_sentence,
    difference,
    difference_cell,
    end_cells,
    enough,
    enough_pairs,
    first_note,
    mean_cell,
    undisturbed,
    values,
)
from layflat.app.support.statistics import statistics

HEADER = ("", "n", "max", "mean", "min", "95\u00a0%\u00a0CI of mean", *END_HEADER)
NOTE = (
    "As Table 4-1: contact portion at the end of placing, from the camera (Eq. 4-7). The thesis's numbers are of its "
    "robot; it does not say how many runs "
    "they summarise. Mesh contact is the share of the cloth's area that rests on the table. Flat at the end: flat "
    "area above 0.97, with the 95 % Wilson interval."
)
FULL_CONTACT = 0.99
"""What counts as 100 %: the camera's noise takes some tenths of a percent."""


def show(material: ExperimentResults) -> ExperimentOutput:
    """For each robot a table, what differs, curves, and a strip of each policy."""
    blocks: list[Block] = []
    claims: list[Claim] = []
    for trial in placing(material.size):
        rows = undisturbed(material.rows(trial))
        claims += _claims(trial, rows)
        if not len(rows):
            blocks.append(Text(lines=(f"{trial.robot}: {MISSING}",)))
            continue
        blocks.append(
            TableBlock(
                table=placing_table(rows), title=f"{trial.robot} robot, {trial.cloth}", note=first_note(blocks, NOTE)
            )
        )
        found = difference(rows, PROPOSED, BASELINE, "contact_final")
        blocks.append(Text(lines=(difference_sentence(PROPOSED, BASELINE, "contact_final", found),), finding=True))
        blocks.append(material.curves(trial, rows))
        for policy in policies_of(rows):
            blocks += material.strips(trial, policy, "none")
    return ExperimentOutput(blocks=tuple(blocks), claims=tuple(claims))


def placing_table(rows: pd.DataFrame, *, beside: bool = True) -> Table:
    """Table 4-1 with ours below the thesis's, or ours alone."""
    lines, ours = [], []
    for policy in policies_of(rows):
        if beside and policy in thesis.PLACING:
            top, mean, least = thesis.PLACING[policy]
            lines.append((f"{policy}, thesis", "", percent(top), percent(mean), percent(least), *[""] * 5))
            ours.append(False)
        mine = rows[rows["policy"] == policy]
        found = values(mine, "contact_final")
        numbers = statistics(found)
        lines.append(
            (
                policy,
                str(len(mine)),
                percent(numbers["max"]),
                percent(numbers["mean"]),
                percent(numbers["min"]),
                interval(numbers["low"], numbers["high"], ".1f"),
                *end_cells(mine),
            )
        )
        ours.append(True)
    return Table(HEADER, tuple(lines), tuple(ours))


def _claims(trial: Trial, rows: pd.DataFrame) -> Iterator[Claim]:
    for policy, stated in thesis.PLACING_SIMULATED.items():
        found = values(rows, "contact_final", policy)
        full = int((found >= FULL_CONTACT).sum())
        yield Claim(
            what=f"{policy} places to 100 % in simulation ({trial.robot})",
            source=stated.source,
            thesis=percent(stated.value),
            ours=f"{mean_cell(found)}; {full} of {len(found)} at 99 % or more" if len(found) else UNKNOWN,
            holds=enough(found) or by_share(full, len(found)),
        )
    for policy, (_, mean, _) in thesis.PLACING.items():
        found = values(rows, "contact_final", policy)
        yield Claim(
            what=f"mean contact of {policy} after placing ({trial.robot})",
            source=thesis.PLACING_SOURCE,
            thesis=percent(mean),
            ours=contact_sentence(found),
            holds=enough(found) or by_value(mean, found),
        )
    pair = difference(rows, PROPOSED, BASELINE, "contact_final")
    yield Claim(
        what=f"in placing the two do not differ ({trial.robot})",
        source="chapters 4-2-2, 4-3-2",
        thesis="no significant difference",
        ours=difference_cell(pair) if pair.n else UNKNOWN,
        holds=enough_pairs(pair) or (NO if pair.is_significant else YES),
    )
