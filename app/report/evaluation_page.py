"""DIR/report.html of an evaluation: its results in numbers, figures and examples."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd

from layflat.app.evaluation.paired import CONDITION
from layflat.app.media.episode_renderer import EpisodeRenderer
from layflat.app.report import charts
from layflat.app.report.blocks import Block, Figure, Page, Section, TableBlock, Text
from layflat.app.report.comparison_sentences import compare_policies, comparison_sentence, paired_table
from layflat.app.report.conditions import conditions_section
from layflat.app.report.examples import FILMS, example_blocks, film_runs
from layflat.app.report.headline import UNDISTURBED, headline_cards
from layflat.app.report.page import OnProgress, no_progress, write_page
from layflat.app.report.policies import policies_of
from layflat.app.report.result_tables import GROUP_NOTE, episode_table, failure_table, group_table
from layflat.app.report.results_like import ResultsFolder, ResultsLike
from layflat.app.report.table_cells import values
from layflat.app.report.thesis_numbers import BASELINE
from layflat.app.report.thesis_tables import (
    DISTURBANCE_NOTE,
    PLACING_NOTE,
    disturbance_table,
    placing_table,
    with_outcomes,
)
from layflat.app.support.formatting import list_numbers
from layflat.app.support.phases import disturbance_outcomes
from layflat.app.support.seeds import taught_text
from layflat.sim.physics.registry import DEFAULT_PHYSICS
from layflat.sim.tasks import DEFAULT_TASK

THESIS = "thesis"
"""Disturbance whose section can have the thesis's table."""
USUAL = {"task": DEFAULT_TASK, "physics": DEFAULT_PHYSICS}
"""Values that a section's title leaves out."""
MAX_CURVES = 200
"""Episodes of a policy in a condition whose curves are read; the first by seed."""
MAX_ROWS = 2000
EPISODES_NOTE = (
    "The commands are for this page's folder. They show an episode's numbers; with --video FILE.webm they make a film. "
    "layflat data plot FILE.h5 --out FILE.png draws its curves."
)
MOMENTS = {"contact_placed": "before", "contact_disturbed": "after the disturbance", "contact_final": "final"}


@dataclass(frozen=True, kw_only=True)
class PageOptions:
    """Parts of the page that cost time, or that only some pages have."""

    title: str = ""
    """By default from the folder's name."""
    films: int | None = FILMS
    """Most films; None: of the best, the typical and the worst episode of each policy."""
    first: str = ""
    """Policy whose films come first."""
    thesis_tables: bool = False
    """Whether the thesis's Tables 4-1 and 4-2 stand above ours."""
    sections: tuple[Section, ...] = ()
    """Further sections, before the failures."""


def write_evaluation(
    results: ResultsFolder, options: PageOptions | None = None, *, on_progress: OnProgress = no_progress
) -> Path:
    """Write the page of an evaluation into its folder; return its path."""
    path, options = results.folder / "report.html", options or PageOptions()
    title = options.title or f"Evaluation: {results.folder.resolve().name}"
    with EpisodeRenderer() as renderer:
        taught = [taught_text(entry["policy"], entry["seeds"]) for entry in results.summary.get("taught", ())]
        provenance = _provenance(results.summary)
        page = evaluation_page(
            results, renderer, options, title=title, notes=taught, provenance=provenance, on_progress=on_progress
        )
        write_page(path, page, on_progress=on_progress)
    return path


def evaluation_page(
    results: ResultsLike,
    renderer: EpisodeRenderer,
    options: PageOptions,
    *,
    title: str,
    notes: Sequence[str] = (),
    provenance: Sequence[str] = (),
    on_progress: OnProgress = no_progress,
) -> Page:
    """Make the page; its videos are drawn when it is written, while ``renderer`` must be open."""
    rows = results.rows
    films = film_runs(rows, options.films, options.first)
    conditions = list(rows.groupby(list(CONDITION), sort=False))
    sections = []
    for key, part in conditions:
        sections.append(_section(results, renderer, options, dict(zip(CONDITION, key, strict=True)), part, films))
        on_progress(0.5 / len(conditions), sections[-1].title)
    return Page(
        title=title,
        lead=_lead(rows),
        cards=headline_cards(rows),
        sections=(
            *sections,
            *filter(None, [conditions_section(rows)]),
            *options.sections,
            failures_section(rows),
            _episodes(rows),
        ),
        notes=(*notes, *_notes(rows)),
        provenance=tuple(provenance),
    )


def moment_boxes(rows: pd.DataFrame) -> Figure | None:
    """Draw contact before, after and final for each policy; None without any value."""
    by_policy = {
        name: {policy: values(rows, column, policy) for policy in policies_of(rows)} for column, name in MOMENTS.items()
    }
    groups = {name: group for name, group in by_policy.items() if any(map(len, group.values()))}
    if not groups:
        return None
    if len(groups) == 2:  # undisturbed: "before" and "final" are the same moment
        groups.pop("before")
    few = f"; boxes, from {charts.MIN_BOX} episodes on, are quartiles"
    return charts.box_plots(groups, caption=f"Contact portion: one mark an episode, the line is the median{few}.")


def contact_curves(rows: pd.DataFrame, curve: Callable[[str], charts.Curve]) -> Figure:
    """Draw contact over time of each policy, median and quartiles; ``curve`` takes the name of a run."""
    groups = {}
    for policy in policies_of(rows):
        mine = rows[(rows["policy"] == policy) & ~rows["crashed"].astype(bool)].sort_values("seed")[:MAX_CURVES]
        groups[policy] = [curve(run) for run in mine["run"]]
    caption = (
        "Contact portion over time: median (line), and the middle half of the episodes (band); a run that has "
        "ended keeps its last value."
    )
    if max(map(len, groups.values())) == MAX_CURVES:
        caption += f" Of each policy the first {MAX_CURVES} episodes."
    return charts.contact_over_time(groups, caption=caption)


def _contact_figure(results: ResultsLike, rows: pd.DataFrame) -> Figure:
    """Draw boxes and curves beside each other, under the curves' legend."""
    boxes = moment_boxes(rows)
    curves = contact_curves(rows, lambda run: charts.curve_of(results.episode(run)))
    if boxes is None:
        return curves
    return replace(
        curves,
        panels=(*boxes.panels, *curves.panels),
        alt=f"{boxes.alt} {curves.alt}",
        caption=f"{boxes.caption} {curves.caption}",
    )


def _section(
    results: ResultsLike,
    renderer: EpisodeRenderer,
    options: PageOptions,
    condition: Mapping[str, str],
    rows: pd.DataFrame,
    films: Collection[str],
) -> Section:
    disturbance = condition["disturbance"]
    case = "undisturbed" if disturbance == UNDISTURBED else f"disturbance {disturbance}"
    unusual = [condition[name] for name, usual in USUAL.items() if condition[name] != usual]
    title = ", ".join((condition["robot"], condition["cloth"], *unusual, case))
    blocks: list[Block | None] = [TableBlock(table=group_table(rows), note=GROUP_NOTE)]
    if options.thesis_tables:
        blocks.append(_thesis_table(results, rows, disturbance))
    blocks += _comparisons(rows, "contact_final" if disturbance == UNDISTURBED else "gain")
    blocks += [_contact_figure(results, rows), *example_blocks(results, renderer, rows, films)]
    return Section(
        id=re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-"),
        title=title[0].upper() + title[1:],
        lead=f"Seeds {list_numbers(rows['seed'])}; {len(rows)} episodes.",
        blocks=tuple(block for block in blocks if block is not None),
    )


def _thesis_table(results: ResultsLike, rows: pd.DataFrame, disturbance: str) -> TableBlock | None:
    title = "Beside the thesis's numbers"
    if disturbance == UNDISTURBED:
        return TableBlock(table=placing_table(rows), title=title, note=PLACING_NOTE)
    if disturbance == THESIS:
        outcomes = with_outcomes(rows, lambda run: disturbance_outcomes(results.episode(run)))
        return TableBlock(table=disturbance_table(outcomes), title=title, note=DISTURBANCE_NOTE)
    return None


def _comparisons(rows: pd.DataFrame, quantity: str) -> list[Block]:
    """Compare each policy with the baseline where it takes part, else with the first."""
    policies = policies_of(rows)
    reference = BASELINE if BASELINE in policies else policies[0]
    pairs = [(policy, reference) for policy in policies if policy != reference]
    if not pairs:
        return []
    lines = [comparison_sentence(a, b, quantity, compare_policies(rows, a, b, quantity)) for a, b in pairs]
    note = "Differences over the same starts and disturbances."
    table = TableBlock(table=paired_table(rows, pairs), title="Paired differences", note=note)
    return [Text(lines=tuple(lines), finding=True), table]


def failures_section(rows: pd.DataFrame) -> Section:
    """List what failed, and why."""
    table = failure_table(rows)
    block: Block = Text(lines=("Nothing: every episode ended flat, by its own decision.",))
    if table.rows:
        note = "An episode is listed once, under the first of: crashed, diverged, interrupted, cut off, not flat."
        block = TableBlock(table=table, note=note)
    return Section(id="failed", title="What failed, and why", blocks=(block,))


def _episodes(rows: pd.DataFrame) -> Section:
    note = EPISODES_NOTE if len(rows) <= MAX_ROWS else f"{EPISODES_NOTE} The first {MAX_ROWS}; episodes.csv has all."
    table = episode_table(rows[:MAX_ROWS])
    block = TableBlock(table=table, title=f"{len(rows)} episodes", note=note, folded=True)
    return Section(id="episodes", title="Every episode", blocks=(block,))


def _lead(rows: pd.DataFrame) -> str:
    counts = [f"{n} {name}" + "s" * (n != 1) for name in ("robot", "cloth") for n in (rows[name].nunique(),)]
    disturbances = ", ".join(dict.fromkeys(rows["disturbance"]))
    return (
        f"{len(rows)} episodes: {', '.join(policies_of(rows))}; {', '.join(counts)}; disturbances: {disturbances}; "
        f"seeds {list_numbers(rows['seed'])}."
    )


def _notes(rows: pd.DataFrame) -> Iterator[str]:
    n_crashed = int(rows["crashed"].astype(bool).sum())
    if n_crashed:
        yield f"{n_crashed} of {len(rows)} episodes crashed and have no numbers; see \u201cWhat failed, and why\u201d."


def _provenance(summary: Mapping[str, Any]) -> tuple[str, ...]:
    known = summary.get("provenance", {})
    versions = ", ".join(f"{name} {number}" for name, number in known.get("versions", {}).items())
    seeds = ", ".join(map(str, known.get("seeds", ())))
    lines = (known.get("command", ""), f"{known.get('created_utc', '')} (UTC), {known.get('platform', '')}", versions)
    return (*(line for line in lines if line), f"seeds {seeds}") if known else ()
