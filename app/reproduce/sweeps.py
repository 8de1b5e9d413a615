"""How many demonstrations are needed, whether one cloth teaches for another, and other learners."""

from __future__ import annotations

import pandas as pd

from layflat.app.report import charts
from layflat.app.report.blocks import Block, Figure, TableBlock, Text
from layflat.app.report.comparison_sentences import difference_sentence
from layflat.app.report.result_tables import policies_of
from layflat.app.report.tables import Table
from layflat.app.report.thesis_numbers import PROPOSED
from layflat.app.reproduce.experiment_results import MISSING, ExperimentOutput, ExperimentResults
from layflat.app.reproduce.studies import (
    NAPKIN,
    TOWEL,
    Trial,
    comparators,
    counted,
    number_of_demonstrations,
    other_cloth,
    placing,
    second_cloth,
)
from layflat.app.reproduce.table_cells import (
    area_cell,
    difference,
    disturbed,
    flat_cell,
    gain_cell,
    lost_cell,
    mean_cell,
    range_cell,
    undisturbed,
    values,
)
from layflat.data.arrays import FloatArray
from layflat.sim.robots.registry import ROBOTS

HEADER = (
    "",
    "n",
    "placed [95\u00a0%\u00a0CI]",
    "min,\u00a0max",
    "flat area (min)",
    "flat after placing",
    "regained, points [95\u00a0%\u00a0CI]",
    "flat after repair",
    "lost",
)
SAME, OTHER = "same", "other"


def show_counts(material: ExperimentResults) -> ExperimentOutput:
    """Contact after placing and what is regained, against the number of demonstrations."""
    blocks: list[Block] = []
    size = material.size
    lines: dict[str, list[tuple[float, FloatArray]]] = {}
    gains: dict[str, list[tuple[float, FloatArray]]] = {}
    for robot in ROBOTS:
        (sweep,) = (trial for trial in number_of_demonstrations(size) if trial.robot == robot)
        (main,) = (trial for trial in placing(size) if trial.robot == robot)
        rows = material.rows(sweep)
        if not len(rows):
            blocks.append(Text(lines=(f"{robot}: {MISSING}",)))
            continue
        whole = _same_starts(material, main, rows)
        by_count = {count: rows[rows["policy"] == counted(count)] for count in size.counts}
        by_count[size.demonstrations] = whole[whole["policy"] == PROPOSED] if len(whole) else whole
        known = {count: part for count, part in by_count.items() if len(part)}
        cells = tuple((f"{count} demonstration{'s' * (count > 1)}", *_cells(part)) for count, part in known.items())
        note = f"{PROPOSED}, {sweep.cloth}; the first demonstrations by seed that ended flat, the same starts for all."
        table = Table(("", *HEADER[1:]), cells, (True,) * len(cells))
        blocks.append(TableBlock(table=table, title=f"{robot} robot", note=note))
        lines[f"{robot} robot"] = [(count, values(undisturbed(part), "contact_final")) for count, part in known.items()]
        gains[f"{robot} robot"] = [(count, values(disturbed(part), "gain")) for count, part in known.items()]
    if lines:
        png = charts.against({"contact after placing (%)": lines, "regained (points)": gains}, xlabel="demonstrations")
        caption = "Means with their 95 % bootstrap intervals."
        blocks.append(Figure(png=png, alt="contact against the number of demonstrations", caption=caption))
    return ExperimentOutput(blocks=tuple(blocks))


def show_cloths(material: ExperimentResults) -> ExperimentOutput:
    """Models that were taught on one cloth, on the other, beside those that were taught on it."""
    blocks: list[Block] = []
    size = material.size
    own = {(trial.robot, trial.cloth): trial for trial in (*placing(size), *second_cloth(size))}
    for trial in other_cloth(size):
        rows = material.rows(trial)
        title = f"{trial.robot} robot, tested on the {trial.cloth}"
        if not len(rows):
            blocks.append(Text(lines=(f"{title}: {MISSING}",)))
            continue
        taught_on = TOWEL if trial.cloth == NAPKIN else NAPKIN
        same = _same_starts(material, own[trial.robot, trial.cloth], rows)
        cells, findings = [], []
        for policy in policies_of(rows):
            if len(same):
                cells.append((f"{policy}, taught on the {trial.cloth}", *_cells(same[same["policy"] == policy])))
            cells.append((f"{policy}, taught on the {taught_on}", *_cells(rows[rows["policy"] == policy])))
            if len(same):
                findings.append(_other_against_same(rows, same, policy))
        blocks.append(TableBlock(table=Table(HEADER, tuple(cells), (True,) * len(cells)), title=title))
        if findings:
            blocks.append(Text(lines=tuple(findings), finding=True))
    return ExperimentOutput(blocks=tuple(blocks))


def show_comparators(material: ExperimentResults) -> ExperimentOutput:
    """Other learners from the same demonstrations."""
    blocks: list[Block] = []
    size = material.size
    trials = list(comparators(size))
    if not trials:
        return ExperimentOutput(blocks=(Text(lines=("No other learner is known to this version.",)),))
    for trial in trials:
        (main,) = (each for each in placing(size) if each.robot == trial.robot)
        rows = material.rows(trial)
        if not len(rows):
            blocks.append(Text(lines=(f"{trial.robot}: {MISSING}",)))
            continue
        both = pd.concat([_same_starts(material, main, rows), rows], ignore_index=True)
        cells = tuple((policy, *_cells(both[both["policy"] == policy])) for policy in policies_of(both))
        blocks.append(
            TableBlock(table=Table(HEADER, cells, (True,) * len(cells)), title=f"{trial.robot} robot, {trial.cloth}")
        )
        findings = [
            difference_sentence(PROPOSED, policy, column, difference(part(both), PROPOSED, policy, column))
            for policy in policies_of(rows)
            for part, column in ((undisturbed, "contact_final"), (disturbed, "gain"))
        ]
        blocks.append(Text(lines=tuple(findings), finding=True))
        blocks.append(material.curves(trial, disturbed(rows)))
    return ExperimentOutput(blocks=tuple(blocks))


def _same_starts(material: ExperimentResults, trial: Trial, rows: pd.DataFrame) -> pd.DataFrame:
    """The trial's rows from the starts that ``rows`` has; of disturbed episodes the first disturbance only."""
    whole = material.rows(trial)
    if not len(whole):
        return whole
    mine = whole[whole["seed"].isin(set(rows["seed"]))].copy()
    if "regained_1" in mine:
        mine["gain"] = mine["regained_1"]
    return mine


def _cells(rows: pd.DataFrame) -> tuple[str, ...]:
    early, late = undisturbed(rows), disturbed(rows)
    placed = values(early, "contact_final")
    return (
        str(len(early)),
        mean_cell(placed),
        range_cell(placed),
        area_cell(values(early, "flat_area_final")),
        flat_cell(early),
        gain_cell(values(late, "gain")),
        flat_cell(late),
        lost_cell(rows),
    )


def _other_against_same(rows: pd.DataFrame, same: pd.DataFrame, policy: str) -> str:
    """One sentence: taught on the other cloth against taught on the tested one, contact after placing."""
    named = [
        undisturbed(part[part["policy"] == policy]).assign(policy=name) for part, name in ((rows, OTHER), (same, SAME))
    ]
    both = pd.concat(named, ignore_index=True)
    pair = difference(both, OTHER, SAME, "contact_final")
    return difference_sentence(f"{policy} of the other cloth", "that of the same", "contact_final", pair)
