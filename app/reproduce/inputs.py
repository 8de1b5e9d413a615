"""Contribution of each input of the model: position, contact, WORD, all; beside a rule of three lines."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import pandas as pd

from layflat.app.evaluation.paired import MIN_PAIRS, PairedComparison
from layflat.app.report import charts
from layflat.app.report.blocks import Table, Text
from layflat.app.report.comparison_sentences import compare_policies, comparison_sentence
from layflat.app.report.policies import policies_of
from layflat.app.report.table_cells import (
    area_cell,
    difference_cell,
    flat_cell,
    gain_cell,
    lost_cell,
    mean_cell,
    values,
)
from layflat.app.report.thesis_numbers import BASELINE, PROPOSED
from layflat.app.reproduce import studies
from layflat.app.reproduce.experiment_output import ExperimentOutput
from layflat.app.reproduce.experiment_results import ExperimentResults
from layflat.app.reproduce.studies import CONTACT, DIRECTION, DISTURBANCE, RULED, TUG, UNDISTURBED, of_case
from layflat.app.support.formatting import MISSING, interval, points
from layflat.sim.robots.registry import THESIS_ROBOTS

INPUTS = {
    BASELINE: "position",
    CONTACT: "position, contact",
    DIRECTION: "position, WORD",
    PROPOSED: "position, WORD, contact",
    RULED: "position; repair: drags while contact grows",
}
PAIRS = (
    (CONTACT, BASELINE, "contact, to position"),
    (DIRECTION, BASELINE, "WORD, to position"),
    (PROPOSED, CONTACT, "WORD, to position and contact"),
    (PROPOSED, DIRECTION, "contact, to position and WORD"),
    (PROPOSED, BASELINE, "both, to position"),
    (PROPOSED, RULED, "learning, over the rule"),
)
WORD_PAIRS = tuple(pair for pair in PAIRS if pair[2].startswith("WORD"))
HEADER = (
    "policy", "sees", "n", "placed", "flat after placing", "regained, first", "second", "tug aside",
    "flat area after repair (min)", "flat after repair", "lost",
)  # fmt: skip
QUESTIONS = (
    ("placed", "contact_final", UNDISTURBED),
    ("flat area after placing", "flat_area_final", UNDISTURBED),
    ("regained, first", "regained_1", DISTURBANCE),
    ("regained, second", "regained_2", DISTURBANCE),
    ("flat area after repair", "flat_area_final", DISTURBANCE),
    ("regained, tug aside", "regained_1", TUG),
    ("flat area after tug aside", "flat_area_final", TUG),
)
"""Comparisons of each pair: name, column, and disturbance."""
REPAIRS = (("regained_1", DISTURBANCE), ("regained_2", DISTURBANCE), ("regained_1", TUG))
PAIRED_HEADER = ("adds", "n", *(name for name, _, _ in QUESTIONS))
NOTE = (
    "Paired over the same starts and disturbances, a less b, in points (flat area: hundredths of the cloth), with "
    "the 95 % bootstrap interval. Of twenty intervals one leaves 0 out by chance."
)


def render_inputs(results: ExperimentResults) -> ExperimentOutput:
    """Render a table of policies and one of differences for each robot, and in sentences what WORD adds."""
    output = ExperimentOutput()
    found: dict[str, pd.DataFrame] = {}
    for robot in THESIS_ROBOTS:
        trials = [t for t in (*studies.placing(results.scale), *studies.inputs(results.scale)) if t.robot == robot]
        rows = results.rows(*trials)
        if not len(rows) or not {CONTACT, DIRECTION} & set(rows["policy"]):
            output.add_missing(robot)
            continue
        found[robot] = rows
        output.add_table(_policy_table(rows), title=f"{robot} robot, {trials[0].cloth}")
        output.add_table(_difference_table(rows), note=NOTE)
        moments = ("after the first disturbance", "after the second", "after a tug aside")
        groups = {
            moment: {policy: values(of_case(rows, disturbance), column, policy) for policy in policies_of(rows)}
            for moment, (column, disturbance) in zip(moments, REPAIRS, strict=True)
        }
        caption = "Contact regained, a dot each episode; boxes are quartiles."
        output.blocks.append(charts.box_plots(groups, title=f"regained (points), {robot}", caption=caption))
    if found:
        output.blocks.insert(0, Text(lines=tuple(word_contribution(found)), finding=True))
    return output


def word_contribution(found: Mapping[str, pd.DataFrame]) -> Iterator[str]:
    """Say where the numbers show that WORD helps or harms, where they show nothing, and how the rule compares."""
    significant: list[tuple[str, PairedComparison]] = []
    total = 0
    for robot, rows in found.items():
        for a, b, adds in WORD_PAIRS:
            for name, column, disturbance in QUESTIONS:
                pair = compare_policies(of_case(rows, disturbance), a, b, column)
                total += pair.n >= MIN_PAIRS
                if pair.is_significant:
                    where = f"{name}, {robot} robot, added {adds.removeprefix('WORD, ')}"
                    significant.append((f"{where}: {difference_cell(pair)}", pair))
    if not total:
        yield f"Fewer than {MIN_PAIRS} pairs are too few to say what WORD adds."
        return
    better = [text for text, pair in significant if pair.mean > 0]
    worse = [text for text, pair in significant if pair.mean < 0]
    yield (
        f"What WORD's direction adds: of {total} comparisons {len(better)} show that it helps, {len(worse)} that it "
        f"harms, and {total - len(significant)} no difference that these n can show."
    )
    if better:
        yield "It helps in: " + "; ".join(better) + "."
    if worse:
        yield "It harms in: " + "; ".join(worse) + "."
    for robot, rows in found.items():
        for a, b, _ in (PAIRS[0], PAIRS[-1]):
            for column, disturbance in REPAIRS:
                pair = compare_policies(of_case(rows, disturbance), a, b, column)
                if pair.n:
                    yield comparison_sentence(a, b, column, pair, f"{robot} robot, {disturbance}")


def _policy_table(rows: pd.DataFrame) -> Table:
    lines = []
    for policy in sorted(policies_of(rows), key=list(INPUTS).index):
        mine = rows[rows["policy"] == policy]
        placed, disturbed, tugged = (of_case(mine, case) for case in (UNDISTURBED, DISTURBANCE, TUG))
        gains = [values(disturbed, "regained_1"), values(disturbed, "regained_2"), values(tugged, "regained_1")]
        ends = (area_cell(values(disturbed, "flat_area_final")), flat_cell(disturbed), lost_cell(mine))
        contact = mean_cell(values(placed, "contact_final"))
        counts = (str(len(placed)), contact, flat_cell(placed))
        lines.append((policy, INPUTS[policy], *counts, *map(gain_cell, gains), *ends))
    return Table(HEADER, tuple(lines))


def _difference_table(rows: pd.DataFrame) -> Table:
    lines = []
    for a, b, adds in PAIRS:
        pairs = [compare_policies(of_case(rows, case), a, b, column) for _, column, case in QUESTIONS]
        if any(pair.n for pair in pairs):
            lines.append((f"{adds}: {a} \u2212 {b}", str(pairs[0].n), *map(_starred, pairs)))
    return Table(PAIRED_HEADER, tuple(lines))


def _starred(pair: PairedComparison) -> str:
    """Format the difference in points, with a star where its interval excludes 0."""
    if not pair.n:
        return MISSING
    return f"{points(pair.mean)} [{interval(pair.low, pair.high, '+.1f')}]" + " *" * pair.is_significant
