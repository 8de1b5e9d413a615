"""Figures 3-5 to 3-8: wrinkle removal by WORD, beside stretching to the right and random moves."""

from __future__ import annotations

import pandas as pd

from app import thesis_numbers as thesis
from app.report import charts
from app.report.blocks import Block, Figure, TableBlock, Text
from app.report.rows import policies_of
from app.report.sentences import difference_sentence
from app.reproduce.material import MISSING, Claim, Material, Shown
from app.reproduce.studies import flattening
from app.reproduce.words import (
    NO,
    PART,
    UNKNOWN,
    YES,
    area_cell,
    contact_sentence,
    difference,
    flat_cell,
    lost_cell,
    mean_cell,
    range_cell,
    values,
)  # fmt: skip
from app.tables import Table, percent
from data.types import FloatArray
from policy.flatten import CONTROLLERS, FLAT_CONTACT

HEADER = (
    "controller",
    "n",
    "start: camera",
    "start: mesh",
    "final: mean [95\u00a0%\u00a0CI]",
    "min,\u00a0max",
    "mesh",
    "flat area (min)",
    "flat at the end",
    "lost",
)
WORD, RIGHT, RANDOM = CONTROLLERS


def show(material: Material) -> Shown:
    """Table, claims, boxes, curves and a strip of each controller."""
    (trial,) = flattening(material.size)
    rows = material.rows(trial)
    if not len(rows):
        return Shown(blocks=(Text(lines=(MISSING,)),), claims=_claims(material, rows))
    lines, ours = [], []
    for name in policies_of(rows):
        mine = rows[rows["policy"] == name]
        stated = thesis.FLATTENING[name]
        start = percent(thesis.FLATTENING_START_SEEN.value)
        lines.append(
            (f"{name}, thesis", "1", start, percent(thesis.FLATTENING_START.value), percent(stated.value), *[""] * 5)
        )
        lines.append(
            (
                name,
                str(len(mine)),
                mean_cell(values(mine, "contact_start")),
                mean_cell(values(mine, "mesh_start")),
                mean_cell(values(mine, "contact_final")),
                range_cell(values(mine, "contact_final")),
                percent(float(values(mine, "contact_final_true").mean())),
                area_cell(values(mine, "flat_area_final")),
                flat_cell(mine),
                lost_cell(mine),
            )
        )
        ours += [False, True]
    findings = [
        difference_sentence(WORD, other, "contact_final", difference(rows, WORD, other, "contact_final"))
        for other in (RIGHT, RANDOM)
    ]
    final: dict[str, dict[str, FloatArray]] = {"start": {}, "final": {}}
    for name in policies_of(rows):
        final["start"][name] = values(rows, "contact_start", name)
        final["final"][name] = values(rows, "contact_final", name)
    blocks: list[Block] = [
        Text(lines=tuple(findings), finding=True),
        TableBlock(table=Table(HEADER, tuple(lines), tuple(ours)), note=NOTE),
        Figure(png=charts.boxes(final), alt="contact at the start and at the end", caption="Every dot is one start."),
    ]
    blocks.append(material.curves(trial, rows))
    for name in policies_of(rows):
        blocks += material.strips(trial, name, "none")
    return Shown(blocks=tuple(blocks), claims=_claims(material, rows))


NOTE = (
    "The thesis's contact at the start is stated once, for all (74 % of the particles, 74.34 % in Figure 3-6). Ours "
    "begin from the crumpled starts of "
    "docs/flatten.md, other ones for every seed; a controller's episode ends at 99 % for six ticks, at the end of "
    "the view, or after 60 ticks."
)


def _claims(material: Material, rows: pd.DataFrame) -> tuple[Claim, ...]:
    claims = []
    for name, stated in thesis.FLATTENING.items():
        found = values(rows, "contact_final", name)
        holds = UNKNOWN
        if len(found):
            if name == WORD:
                share = float((found >= FLAT_CONTACT).mean())
                holds = YES if share >= 0.9 else PART if share >= 0.5 else NO
            else:
                holds = YES if found.min() <= stated.value <= found.max() else NO
        claims.append(
            Claim(
                what=f"{name} ends at this contact portion",
                source=stated.source,
                thesis=percent(stated.value),
                ours=contact_sentence(found),
                holds=holds,
            )
        )
    pairs = [difference(rows, WORD, other, "contact_final") for other in (RIGHT, RANDOM)] if len(rows) else []
    if pairs:
        holds = UNKNOWN if pairs[0].n < 2 else YES if all(pair.low > 0 for pair in pairs) else NO
        worst = min(pairs, key=lambda pair: pair.low)
        ours = f"at least {100 * worst.mean:+.1f} points, n = {worst.n}"
        claims.append(
            Claim(what="WORD flattens more than both", source="chapter 3-2-2", thesis="yes", ours=ours, holds=holds)
        )
    return tuple(claims)
