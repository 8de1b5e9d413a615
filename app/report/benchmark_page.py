"""The page of a benchmark: scores of policies, in all and in each part, and what they cost."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pandas as pd

from layflat.app.evaluation.benchmark import BREAKDOWNS, Benchmark
from layflat.app.report.blocks import Block, Card, Figure, Page, Section, Table, TableBlock, Text
from layflat.app.report.charts import box_plots
from layflat.app.report.conditions import conditions_section
from layflat.app.report.evaluation_page import failures_section
from layflat.app.support.formatting import MISSING, interval, list_numbers, percent

HEADER = (
    "policy", "robots", "score [95\u00a0%\u00a0CI]", "flat at the end", "episodes", "starts", "lost", "demonstrations",
    "ms a decision",
)  # fmt: skip
NOTE = (
    "The score of an episode is the flat area at its end, in percent of the cloth; a cloth that diverged, or whose "
    "process failed, has 0. Its interval is a 95 % bootstrap interval over placements, since the disturbed and the "
    "undisturbed episodes of a placement share their past. Flat counts flat area above 0.97, with Wilson's interval. "
    "Demonstrations are those that taught the policy; a decision is one call of it, without what the camera costs."
)
PART_NOTES = {
    "variation": "usual: nothing is drawn; the others draw the conditions of each seed, the same for every policy.",
    "disturbance": "none: the undisturbed episodes.",
}


def benchmark_page(
    bench: Benchmark, rows: pd.DataFrame, scores: Sequence[Mapping[str, Any]], lines: Sequence[str]
) -> Page:
    """Make the page; ``lines`` say at its end how it was made."""
    sections = [_ranking(rows, scores), *(_part(name, scores) for name in BREAKDOWNS)]
    drawn = conditions_section(rows[rows["variation"] != "usual"])
    return Page(
        title=bench.title,
        lead=f"{bench.about} Seeds {list_numbers(bench.seeds)}.",
        cards=tuple(_cards(scores)),
        sections=(*sections, *([] if drawn is None else [drawn]), failures_section(rows)),
        notes=tuple(_notes(bench, scores)),
        provenance=tuple(lines),
    )


def score_cell(entry: Mapping[str, Any]) -> str:
    """Format a score with its interval."""
    low, high = entry["ci95"]
    return percent(entry["score"]) + ("" if low is None else f" [{interval(low, high)}]")


def ranking_table(scores: Sequence[Mapping[str, Any]]) -> Table:
    """Make one line for each policy, best first."""
    return Table(HEADER, tuple(tuple(_cells(entry)) for entry in scores))


def _cells(entry: Mapping[str, Any]) -> Iterator[str]:
    low, high = entry["success_wilson95"]
    demonstrations, decision = entry["demonstrations"], entry["decision_ms"]
    yield from (entry["policy"], ", ".join(entry["robots"]), score_cell(entry))
    yield f"{percent(entry['success_rate'])} [{interval(low, high, '.0f')}]"
    yield from (str(entry[name]) for name in ("n", "starts", "lost"))
    yield MISSING if demonstrations is None else str(demonstrations)
    yield MISSING if decision is None else f"{decision:.2f}"


def _ranking(rows: pd.DataFrame, scores: Sequence[Mapping[str, Any]]) -> Section:
    groups = {
        name: {
            entry["policy"]: part.loc[part["policy"] == entry["policy"], "score"].to_numpy(float) for entry in scores
        }
        for name, part in (
            ("undisturbed", rows[rows["disturbance"] == "none"]),
            ("disturbed", rows[rows["disturbance"] != "none"]),
        )
    }
    figure: Figure = box_plots(groups, title="score (%)", caption="One mark an episode.")
    blocks: tuple[Block, ...] = (TableBlock(table=ranking_table(scores), note=NOTE), figure)
    return Section(id="scores", title="Scores", blocks=blocks)


def _part(name: str, scores: Sequence[Mapping[str, Any]]) -> Section:
    values = list(dict.fromkeys(value for entry in scores for value in entry["parts"][name]))
    lines = []
    for entry in scores:
        parts = entry["parts"][name]
        lines.append((entry["policy"], *(score_cell(parts[v]) if v in parts else MISSING for v in values)))
    table = TableBlock(table=Table(("policy", *values), tuple(lines)), note=PART_NOTES.get(name, ""))
    worst = [
        f"{entry['policy']}: lowest with {min(parts, key=lambda value: parts[value]['score'])}."
        for entry in scores
        if name == "cloth" and len(parts := entry["parts"][name]) > 1
    ]
    blocks: list[Block] = [table, *([Text(lines=tuple(worst))] if worst else [])]
    return Section(id=f"by-{name}", title=f"By {name}", blocks=tuple(blocks))


def _cards(scores: Sequence[Mapping[str, Any]]) -> Iterator[Card]:
    for entry in scores[:6]:
        flat = f"{percent(entry['success_rate'])} flat; n = {entry['n']}"
        yield Card(name=entry["policy"], values=(("score, mean", score_cell(entry), flat),))


def _notes(bench: Benchmark, scores: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    if bench.quick:
        yield "This is the quick part: too few episodes to compare policies; run it without --quick."
    if bench.phrase is not None:
        yield f"The seeds follow from the phrase \u201c{bench.phrase}\u201d and are none of the published ones."
    for entry in scores:
        if len(entry["robots"]) < len(bench.robots):
            yield f"{entry['policy']} was made for {' and '.join(entry['robots'])} and has run with no other robot."
