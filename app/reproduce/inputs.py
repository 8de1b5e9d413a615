"""What each input of the model adds: position, + contact, + WORD, all; beside a rule of three lines."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from layflat.app.evaluation.paired import LEAST, PairedComparison
from layflat.app.report import charts
from layflat.app.report.blocks import Block, Figure, TableBlock, Text
from layflat.app.report.comparison_sentences import difference_sentence
from layflat.app.report.result_tables import policies_of
from layflat.app.report.tables import Table, interval, points
from layflat.app.report.thesis_numbers import BASELINE, PROPOSED
from layflat.app.reproduce.experiment_results import MISSING, ExperimentOutput, ExperimentResults
from layflat.app.reproduce.studies import CONTACT, DIRECTION, DISTURBANCE, RULED, TUG, inputs, placing
from layflat.app.reproduce.table_cells import (
    area_cell,
    difference,
    difference_cell,
    disturbed,
    flat_cell,
    gain_cell,
    lost_cell,
    mean_cell,
    values,
)
from layflat.sim.robots.registry import ROBOTS

NONE = "none"
SEES = {
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
    "policy",
    "sees",
    "n",
    "placed",
    "flat after placing",
    "regained, first",
    "second",
    "tug aside",
    "flat area after repair (min)",
    "flat after repair",
    "lost",
)
QUESTIONS = (
    ("placed", "contact_final", NONE),
    ("flat area after placing", "flat_area_final", NONE),
    ("regained, first", "regained_1", DISTURBANCE),
    ("regained, second", "regained_2", DISTURBANCE),
    ("flat area after repair", "flat_area_final", DISTURBANCE),
    ("regained, tug aside", "regained_1", TUG),
    ("flat area after tug aside", "flat_area_final", TUG),
)
"""What is asked of each pair: name, column, and in which episodes."""
PAIRED_HEADER = ("adds", "n", *(name for name, _, _ in QUESTIONS))
NOTE = (
    "PairedComparison over the same starts and disturbances, a less b, in points (flat area: hundredths of the cloth), "
    "with the 95 % bootstrap interval. "
    "Of twenty intervals one leaves 0 out by chance."
)


def show(material: ExperimentResults) -> ExperimentOutput:
    """For each robot a table of policies, one of differences; then, in sentences, what WORD adds."""
    blocks: list[Block] = []
    found: dict[str, pd.DataFrame] = {}
    for robot in ROBOTS:
        trials = [t for t in (*placing(material.size), *inputs(material.size)) if t.robot == robot]
        rows = material.rows(*trials)
        if not len(rows) or not {CONTACT, DIRECTION} & set(rows["policy"]):
            blocks.append(Text(lines=(f"{robot}: {MISSING}",)))
            continue
        found[robot] = rows
        blocks.append(TableBlock(table=_policies(rows), title=f"{robot} robot, {trials[0].cloth}"))
        blocks.append(TableBlock(table=_differences(rows), note=NOTE))
        groups = {
            name: {policy: values(disturbed(rows, what), column, policy) for policy in policies_of(rows)}
            for name, column, what in (
                ("after the first disturbance", "regained_1", DISTURBANCE),
                ("after the second", "regained_2", DISTURBANCE),
                ("after a tug aside", "regained_1", TUG),
            )
        }
        blocks.append(
            Figure(
                png=charts.boxes(groups, unit="regained (points)"),
                alt=f"contact regained by policy, {robot}",
                caption="Contact regained, a dot each episode; boxes are quartiles.",
            )
        )
    if found:
        blocks.insert(0, Text(lines=tuple(what_word_adds(found)), finding=True))
    return ExperimentOutput(blocks=tuple(blocks))


def what_word_adds(found: dict[str, pd.DataFrame]) -> Iterator[str]:
    """Where WORD makes a difference that the numbers show, where they show none, and the rule beside it."""
    clear: list[tuple[str, PairedComparison]] = []
    none = 0
    for robot, rows in found.items():
        for a, b, adds in WORD_PAIRS:
            for name, column, disturbance in QUESTIONS:
                pair = _pair(rows, a, b, column, disturbance)
                if pair.n < LEAST:
                    continue
                if pair.is_significant:
                    clear.append(
                        (f"{name}, {robot} robot, added {adds.removeprefix('WORD, ')}: {difference_cell(pair)}", pair)
                    )
                else:
                    none += 1
    total = len(clear) + none
    if not total:
        yield f"Fewer than {LEAST} pairs are too few to say what WORD adds."
        return
    better = [text for text, pair in clear if pair.mean > 0]
    worse = [text for text, pair in clear if pair.mean < 0]
    yield (
        f"What WORD's direction adds: of {total} comparisons {len(better)} show that it helps, {len(worse)} that it "
        f"harms, and {none} no difference that "
        "these n can show."
    )
    if better:
        yield "It helps in: " + "; ".join(better) + "."
    if worse:
        yield "It harms in: " + "; ".join(worse) + "."
    for robot, rows in found.items():
        for a, b, _ in (PAIRS[0], PAIRS[-1]):
            for column, disturbance in (("regained_1", DISTURBANCE), ("regained_2", DISTURBANCE), ("regained_1", TUG)):
                pair = _pair(rows, a, b, column, disturbance)
                if pair.n:
                    yield difference_sentence(a, b, column, pair, f"{robot} robot, {disturbance}")


def _pair(rows: pd.DataFrame, a: str, b: str, column: str, disturbance: str) -> PairedComparison:
    return difference(disturbed(rows, disturbance), a, b, column)


def _policies(rows: pd.DataFrame) -> Table:
    lines = []
    for policy in sorted(policies_of(rows), key=list(SEES).index):
        mine = rows[rows["policy"] == policy]
        early, late, tugged = disturbed(mine, NONE), disturbed(mine), disturbed(mine, TUG)
        lines.append(
            (
                policy,
                SEES[policy],
                str(len(early)),
                mean_cell(values(early, "contact_final")),
                flat_cell(early),
                gain_cell(values(late, "regained_1")),
                gain_cell(values(late, "regained_2")),
                gain_cell(values(tugged, "regained_1")),
                area_cell(values(late, "flat_area_final")),
                flat_cell(late),
                lost_cell(mine),
            )
        )
    return Table(HEADER, tuple(lines), (True,) * len(lines))


def _differences(rows: pd.DataFrame) -> Table:
    lines = []
    for a, b, adds in PAIRS:
        pairs = [_pair(rows, a, b, column, disturbance) for _, column, disturbance in QUESTIONS]
        if any(pair.n for pair in pairs):
            lines.append((f"{adds}: {a} \u2212 {b}", str(pairs[0].n), *(_marked(pair) for pair in pairs)))
    return Table(PAIRED_HEADER, tuple(lines), (True,) * len(lines))


def _marked(pair: PairedComparison) -> str:
    """The difference in points, starred where its interval leaves 0 out."""
    if not pair.n:
        return "\u2013"
    return f"{points(pair.mean)} [{interval(pair.low, pair.high, '+.1f')}]" + " *" * pair.is_significant
