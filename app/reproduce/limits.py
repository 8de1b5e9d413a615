"""Figures 5-1 and 5-2: a bad first contact, and a corner that is folded over."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from layflat.app.evaluation.summary import with_measures
from layflat.app.report import thesis_numbers as thesis
from layflat.app.report.blocks import Block, TableBlock, Text
from layflat.app.report.result_tables import policies_of
from layflat.app.report.tables import percent
from layflat.app.report.thesis_numbers import PROPOSED
from layflat.app.reproduce.disturbance import disturbance_table
from layflat.app.reproduce.experiment_results import MISSING, Claim, ExperimentOutput, ExperimentResults
from layflat.app.reproduce.placing import placing_table
from layflat.app.reproduce.studies import FOLD, Trial, bad_contact, placing
from layflat.app.reproduce.table_cells import (
    UNKNOWN,
    by_share,
    contact_sentence,
    disturbed,
    enough,
    first_note,
    flat_cell,
    values,
)

NOTE = (
    "Contact portion of the camera at the end; a folded part hides from it, which is why flat area, of the mesh, "
    "stands beside it."
)


def show_bad_contact(material: ExperimentResults) -> ExperimentOutput:
    """What becomes of a cloth whose reverse side touches the table first."""
    blocks: list[Block] = []
    claims: list[Claim] = []
    stated = thesis.BAD_CONTACT
    for trial in bad_contact(material.size):
        rows = disturbed(material.rows(trial), "none")
        claims += _claims(trial, rows, "a bad first contact", stated.source, percent(stated.value))
        if not len(rows):
            blocks.append(Text(lines=(f"{trial.robot}: {MISSING}",)))
            continue
        title, note = f"{trial.robot} robot, {trial.cloth}", first_note(blocks, NOTE)
        blocks.append(TableBlock(table=placing_table(rows, beside=False), title=title, note=note))
        for policy in policies_of(rows):
            blocks += material.strips(trial, policy, "none", pick=_ends)
    return ExperimentOutput(blocks=tuple(blocks), claims=tuple(claims))


def show_folded_corner(material: ExperimentResults) -> ExperimentOutput:
    """What the policies do about a corner that a hand folds over after they have placed the cloth."""
    blocks: list[Block] = []
    claims: list[Claim] = []
    for trial in placing(material.size):
        rows = disturbed(material.rows(trial), FOLD)
        claims += _claims(trial, rows, "a folded corner", "chapter 5-1, Figure 5-2", thesis.FOLDED_CORNER)
        if not len(rows):
            blocks.append(Text(lines=(f"{trial.robot}: {MISSING}",)))
            continue
        title, note = f"{trial.robot} robot, {trial.cloth}", first_note(blocks, NOTE)
        blocks.append(TableBlock(table=disturbance_table(rows, beside=False), title=title, note=note))
        for policy in policies_of(rows):
            blocks += material.strips(trial, policy, FOLD, pick=_ends)
    return ExperimentOutput(blocks=tuple(blocks), claims=tuple(claims))


def _ends(rows: pd.DataFrame) -> list[int]:
    """The episode that ends least flat, and the one that ends flattest."""
    order = rows["flat_area_final"].to_numpy(float).argsort()
    return [int(order[0]), int(order[-1])] if len(order) > 1 else list(range(len(order)))


def _claims(trial: Trial, rows: pd.DataFrame, what: str, source: str, stated: str) -> Iterator[Claim]:
    for policy in policies_of(rows) if len(rows) else (PROPOSED,):
        mine = rows[rows["policy"] == policy] if len(rows) else rows
        contact = values(mine, "contact_final")
        folded = len(mine) - int(with_measures(mine)["success"].sum()) if len(mine) else 0
        yield Claim(
            what=f"{policy} does not flatten {what} ({trial.robot})",
            source=source,
            thesis=stated,
            ours=f"{contact_sentence(contact)}; flat {flat_cell(mine)}" if len(mine) else UNKNOWN,
            holds=enough(contact) or by_share(folded, len(mine)),
        )
