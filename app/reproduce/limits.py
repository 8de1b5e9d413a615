"""Figures 5-1 and 5-2: a bad first contact, and a corner that is folded over."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pandas as pd

from app import thesis_numbers as thesis
from app.pairs import successes
from app.report.blocks import Block, TableBlock, Text
from app.report.rows import policies_of
from app.reproduce.material import MISSING, Claim, Material, Shown
from app.reproduce.placing import placing_table
from app.reproduce.studies import Size, Trial, bad_contact, folded_corner
from app.reproduce.words import UNKNOWN, by_share, contact_sentence, enough, first_note, flat_cell, undisturbed, values
from app.tables import percent
from app.thesis_numbers import PROPOSED

NOTE = (
    "Contact portion of the camera at the end; a folded part hides from it, which is why flat area, of the mesh, "
    "stands beside it."
)


def show_bad_contact(material: Material) -> Shown:
    """What becomes of a cloth whose reverse side touches the table first."""
    stated = thesis.BAD_CONTACT
    return _show(material, bad_contact, "a bad first contact", stated.source, percent(stated.value))


def show_folded_corner(material: Material) -> Shown:
    """What becomes of a cloth that lies with a corner folded over."""
    return _show(material, folded_corner, "a folded corner", "chapter 5-1, Figure 5-2", "stays folded; no number")


def _show(material: Material, trials: Callable[[Size], Iterator[Trial]], what: str, source: str, stated: str) -> Shown:
    blocks: list[Block] = []
    claims: list[Claim] = []
    for trial in trials(material.size):
        rows = undisturbed(material.rows(trial))
        for policy in policies_of(rows) if len(rows) else (PROPOSED,):
            claims.append(_claim(trial, rows, policy, what, source, stated))
        if not len(rows):
            blocks.append(Text(lines=(f"{trial.task}: {MISSING}",)))
            continue
        blocks.append(
            TableBlock(
                table=placing_table(rows, beside=False),
                title=f"{trial.task} task, {trial.cloth}",
                note=first_note(blocks, NOTE),
            )
        )
        for policy in policies_of(rows):
            blocks += material.strips(trial, policy, "none", pick=_ends)
    return Shown(blocks=tuple(blocks), claims=tuple(claims))


def _ends(rows: pd.DataFrame) -> list[int]:
    """The episode that ends least flat, and the one that ends flattest."""
    order = rows["flat_area_final"].to_numpy(float).argsort()
    return [int(order[0]), int(order[-1])] if len(order) > 1 else list(range(len(order)))


def _claim(trial: Trial, rows: pd.DataFrame, policy: str, what: str, source: str, stated: str) -> Claim:
    mine = rows[rows["policy"] == policy] if len(rows) else rows
    contact = values(mine, "contact_final")
    folded = len(mine) - int(successes(mine).sum()) if len(mine) else 0
    return Claim(
        what=f"{policy} does not flatten {what} ({trial.task})",
        source=source,
        thesis=stated,
        ours=f"{contact_sentence(contact)}; flat {flat_cell(mine)}" if len(mine) else UNKNOWN,
        holds=enough(contact) or by_share(folded, len(mine)),
    )
