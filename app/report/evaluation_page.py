"""DIR/report.html of an evaluation: its results in numbers, figures and examples."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import pandas as pd

from layflat.app.evaluation.paired import CONDITION
from layflat.app.evaluation.summary import with_measures
from layflat.app.media.episode_renderer import EpisodeRenderer, is_drawable
from layflat.app.media.frames import key_steps
from layflat.app.report import charts
from layflat.app.report.blocks import Block, Card, Figure, FrameStrip, Page, Section, TableBlock, Text, VideoBlock
from layflat.app.report.comparison_sentences import compare_policies, comparison_sentence, paired_table
from layflat.app.report.page import OnProgress, write_page
from layflat.app.report.policies import policies_of
from layflat.app.report.result_tables import GROUP_NOTE, episode_table, failure_table, group_table
from layflat.app.report.table_cells import values
from layflat.app.report.thesis_numbers import BASELINE
from layflat.app.report.thesis_tables import (
    DISTURBANCE_NOTE,
    PLACING_NOTE,
    disturbance_table,
    placing_table,
    with_outcomes,
)
from layflat.app.support.formatting import list_numbers, percent, points, ratio
from layflat.app.support.phases import disturbance_outcomes
from layflat.app.support.seeds import taught_text
from layflat.data.types import Episode
from layflat.sim.physics.registry import DEFAULT_PHYSICS
from layflat.sim.tasks import DEFAULT_TASK

UNDISTURBED, THESIS = "none", "thesis"
"""Disturbances whose sections can have the thesis's tables."""
USUAL = {"task": DEFAULT_TASK, "physics": DEFAULT_PHYSICS}
"""Values that a section's title leaves out."""
EXAMPLES = ("best", "median", "worst")
STRIP_FRAMES = 6
STRIP_WIDTH = 220
VIDEO_WIDTH = 480
MAX_CURVES = 200
"""Episodes of a policy in a condition whose curves are read; the first by seed."""
MAX_ROWS = 2000
MAX_CARDS = 4
MOMENTS = {"contact_placed": "before", "contact_disturbed": "after the disturbance", "contact_final": "final"}


class ResultsLike(Protocol):
    """Rows and episodes of an evaluation."""

    @property
    def rows(self) -> pd.DataFrame:
        """The contract's columns, ``run`` (the name of an episode), and ``reason`` of a crash; one row per episode."""

    def episode(self, run: str, /) -> Episode:
        """Return the recorded episode of a row that did not crash."""


class ResultsFolder(ResultsLike, Protocol):
    """Results of an evaluation in a folder."""

    @property
    def folder(self) -> Path:
        """The evaluation's --out."""

    @property
    def summary(self) -> dict[str, Any]:
        """Content of summary.json; empty while the evaluation runs for the first time."""


@dataclass(frozen=True, kw_only=True)
class PageOptions:
    """Parts of the page that cost time, or that only some pages have."""

    title: str = ""
    """By default from the folder's name."""
    has_video: Callable[[str, pd.Series], bool] = lambda example, row: False
    """Whether one of EXAMPLES of a policy, whose row is given, gets a video."""
    thesis_tables: bool = False
    """Whether the thesis's Tables 4-1 and 4-2 stand above ours."""
    sections: tuple[Section, ...] = ()
    """Further sections, before the failures."""


def write_evaluation(
    results: ResultsFolder, options: PageOptions | None = None, *, on_progress: OnProgress | None = None
) -> Path:
    """Write the page of an evaluation into its folder; return its path."""
    path, options = results.folder / "report.html", options or PageOptions()
    title = options.title or f"Evaluation: {results.folder.resolve().name}"
    with EpisodeRenderer() as renderer:
        taught = [taught_text(entry["policy"], entry["seeds"]) for entry in results.summary.get("taught", ())]
        provenance = _provenance(results.summary)
        page = evaluation_page(results, renderer, options, title=title, notes=taught, provenance=provenance)
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
) -> Page:
    """Make the page; its videos are drawn when it is written, while ``renderer`` must be open."""
    rows = results.rows
    conditions = rows.groupby(list(CONDITION), sort=False)
    sections = [
        _section(results, renderer, options, dict(zip(CONDITION, key, strict=True)), part) for key, part in conditions
    ]
    return Page(
        title=title,
        lead=_lead(rows),
        cards=tuple(_cards(rows)),
        sections=(*sections, *options.sections, _failures(rows), _episodes(rows)),
        notes=(*notes, *_notes(rows)),
        provenance=tuple(provenance),
    )


def example_rows(rows: pd.DataFrame, column: str = "contact_final") -> list[tuple[str, Mapping[str, Any]]]:
    """Return (name from EXAMPLES, row) by ``column``; each episode once."""
    known = rows[rows[column].notna() & ~rows["crashed"].astype(bool)].sort_values([column, "flat_area_final", "seed"])
    picks = {len(known) - 1: "best", len(known) // 2: "median", 0: "worst"}
    return [(name, known.iloc[at].to_dict()) for at, name in picks.items()] if len(known) else []


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
    caption = "Contact portion, one dot an episode; boxes are quartiles."
    return Figure(png=charts.box_plots(groups), alt="box plots of the contact portion", caption=caption)


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
    return Figure(png=charts.contact_over_time(groups), alt="contact portion over time", caption=caption)


def example_strips(
    results: ResultsLike, renderer: EpisodeRenderer, rows: pd.DataFrame, options: PageOptions
) -> Iterator[Block]:
    """Yield frames (and videos) of the best, the median and the worst episode of each policy."""
    for policy in policies_of(rows):
        for name, row in example_rows(rows[rows["policy"] == policy]):
            episode = results.episode(row["run"])
            caption = (
                f"{name}: seed {row['seed']}, final contact {percent(row['contact_final'])}, flat area "
                f"{ratio(row['flat_area_final'])}, {row['stopped_by']}"
            )
            if is_drawable(episode):
                frames = renderer.frame_strip(episode, key_steps(episode, STRIP_FRAMES), STRIP_WIDTH)
                yield FrameStrip(frames=frames, policy=policy, caption=caption)
                if options.has_video(name, row):
                    video = partial(renderer.camera_frames, episode, VIDEO_WIDTH)
                    yield VideoBlock(frames=video, fps=1.0 / episode.step_s, policy=policy, caption=caption)


def _section(
    results: ResultsLike,
    renderer: EpisodeRenderer,
    options: PageOptions,
    condition: Mapping[str, str],
    rows: pd.DataFrame,
) -> Section:
    disturbance = condition["disturbance"]
    case = "undisturbed" if disturbance == UNDISTURBED else f"disturbance {disturbance}"
    unusual = [condition[name] for name, usual in USUAL.items() if condition[name] != usual]
    title = ", ".join((condition["robot"], condition["cloth"], *unusual, case))
    blocks: list[Block | None] = [TableBlock(table=group_table(rows), note=GROUP_NOTE)]
    if options.thesis_tables:
        blocks.append(_thesis_table(results, rows, disturbance))
    blocks += _comparisons(rows, "contact_final" if disturbance == UNDISTURBED else "gain")
    blocks += [moment_boxes(rows), contact_curves(rows, lambda run: charts.curve_of(results.episode(run)))]
    blocks += example_strips(results, renderer, rows, options)
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


def _failures(rows: pd.DataFrame) -> Section:
    table = failure_table(rows)
    block: Block = Text(lines=("Nothing: every episode ended flat, by its own decision.",))
    if table.rows:
        note = "An episode is listed once, under the first of: crashed, diverged, interrupted, cut off, not flat."
        block = TableBlock(table=table, note=note)
    return Section(id="failed", title="What failed, and why", blocks=(block,))


def _episodes(rows: pd.DataFrame) -> Section:
    note = "" if len(rows) <= MAX_ROWS else f"The first {MAX_ROWS} of {len(rows)}; episodes.csv has all."
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


def _cards(rows: pd.DataFrame) -> Iterator[Card]:
    for policy in policies_of(rows)[:MAX_CARDS]:
        group = with_measures(rows[rows["policy"] == policy])
        final, gain = values(group, "contact_final"), values(group, "gain")
        if len(final):
            below = f"regained {points(gain.mean())} points, n = {len(gain)}" if len(gain) else f"n = {len(final)}"
            yield Card(name=f"{policy}: final contact, mean", value=percent(final.mean()), below=below)


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
