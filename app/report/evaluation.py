"""DIR/report.html of an evaluate folder: what its episodes amount to, shown and told."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pandas as pd

from layflat.app.report import charts
from layflat.app.report.blocks import Block, Card, Figure, FrameStrip, Page, Section, TableBlock, Text, VideoBlock
from layflat.app.report.comparison_sentences import compared, difference_sentence, paired_table
from layflat.app.report.episode_renderer import EpisodeRenderer, drawable, key_steps
from layflat.app.report.page import OnProgress, write_page
from layflat.app.report.result_tables import GROUP_NOTE, every_table, failed_table, group_table, policies_of
from layflat.app.report.tables import percent, points
from layflat.app.report.thesis_numbers import BASELINE
from layflat.data.arrays import FloatArray
from layflat.data.types import Episode

CONDITION = ("robot", "cloth", "disturbance")
"""What has a section of its own."""
STRIP_FRAMES = 6
STRIP_WIDTH = 220
FILM_WIDTH = 480
CURVES_EACH = 200
"""Episodes of a policy in a condition whose curves are read, at most; the first by seed."""
ROWS_SHOWN = 2000
MOMENTS = {"contact_placed": "before", "contact_disturbed": "after the disturbance", "contact_final": "final"}


class ResultsLike(Protocol):
    """What there is of a batch."""

    @property
    def rows(self) -> pd.DataFrame:
        """The contract's columns, ``run`` (the name of an episode), and ``reason`` of a crash; one row per episode."""

    def episode(self, run: str, /) -> Episode:
        """The recorded episode of a row that did not crash."""


class ResultsFolder(ResultsLike, Protocol):
    """The same, and where it lies."""

    @property
    def folder(self) -> Path: ...

    @property
    def summary(self) -> dict[str, Any]:
        """As in summary.json; empty while the batch runs for the first time."""


def write_evaluation(results: ResultsFolder, *, videos: bool = False, on_progress: OnProgress | None = None) -> Path:
    """Write the page of a batch into its folder; ``videos`` films best, median and worst. Returns the page's path."""
    path = results.folder / "report.html"
    with EpisodeRenderer() as painter:
        page = evaluation_page(
            results, painter, title=f"Evaluation: {results.folder.resolve().name}", made=_made(results), videos=videos
        )
        write_page(path, page, on_progress=on_progress)
    return path


def _made(results: ResultsFolder) -> tuple[str, ...]:
    """How the batch came to be, as its summary says."""
    known = results.summary.get("provenance", {})
    versions = ", ".join(f"{name} {number}" for name, number in known.get("versions", {}).items())
    seeds = ", ".join(map(str, known.get("seeds", ())))
    lines = (known.get("command", ""), f"{known.get('created_utc', '')} (UTC), {known.get('platform', '')}", versions)
    return (*(line for line in lines if line), f"seeds {seeds}") if known else ()


def evaluation_page(
    results: ResultsLike, painter: EpisodeRenderer, *, title: str, made: Sequence[str], videos: bool = False
) -> Page:
    """All that the page shows; films are drawn only when it is written, so before ``painter`` is closed."""
    rows = results.rows
    sections = [
        _section(results, painter, dict(zip(CONDITION, key, strict=True)), part, videos)
        for key, part in rows.groupby(list(CONDITION), sort=False)
    ]
    return Page(
        title=title,
        lead=_lead(rows),
        cards=tuple(_cards(rows)),
        sections=(*sections, _failures(rows), _every(rows)),
        notes=tuple(_notes(rows)),
        made=tuple(made),
    )


def reference_of(rows: pd.DataFrame) -> str:
    """Whom the others are compared with: the baseline where it takes part, else the first."""
    policies = policies_of(rows)
    return BASELINE if BASELINE in policies else policies[0]


def examples(rows: pd.DataFrame, column: str = "contact_final") -> list[tuple[str, Mapping[str, Any]]]:
    """("best" | "median" | "worst", row) of the rows that have a value, by ``column``; each episode once."""
    known = rows[rows[column].notna() & ~rows["crashed"].astype(bool)].sort_values([column, "flat_area_final", "seed"])
    picks = {len(known) - 1: "best", len(known) // 2: "median", 0: "worst"}
    return [(name, known.iloc[at].to_dict()) for at, name in picks.items()] if len(known) else []


def moment_boxes(rows: pd.DataFrame) -> Figure | None:
    """Contact before, after and final, for each policy; None where nothing has a value."""
    groups: dict[str, dict[str, FloatArray]] = {}
    for column, name in MOMENTS.items():
        by_policy = {
            policy: rows.loc[rows["policy"] == policy, column].dropna().to_numpy(float) for policy in policies_of(rows)
        }
        if any(len(values) for values in by_policy.values()):
            groups[name] = by_policy
    if not groups:
        return None
    if len(groups) == 2:  # nothing happened between the stop and the end
        groups.pop("before")
    caption = "Contact portion, one dot an episode; boxes are quartiles."
    return Figure(png=charts.boxes(groups), alt="box plots of the contact portion", caption=caption)


def contact_curves(rows: pd.DataFrame, curve: Callable[[str], charts.Curve]) -> Figure:
    """Contact over time of each policy, median and quartiles; ``curve`` is asked for each run's."""
    groups = {}
    for policy in policies_of(rows):
        kept = rows[(rows["policy"] == policy) & ~rows["crashed"].astype(bool)].sort_values("seed")[:CURVES_EACH]
        groups[policy] = [curve(run) for run in kept["run"]]
    most = max(len(group) for group in groups.values())
    caption = (
        "Contact portion over time: median (line), and the middle half of the episodes (band); a run that has "
        "ended keeps its last value."
    )
    if most == CURVES_EACH:
        caption += f" Of each policy the first {CURVES_EACH} episodes."
    return Figure(png=charts.spread_over_time(groups), alt="contact portion over time", caption=caption)


def example_strips(
    results: ResultsLike, painter: EpisodeRenderer, rows: pd.DataFrame, *, videos: bool
) -> Iterator[Block]:
    """Frames (and films) of the best, the median and the worst episode of each policy."""
    for policy in policies_of(rows):
        for name, row in examples(rows[rows["policy"] == policy]):
            episode = results.episode(row["run"])
            step_indices = key_steps(episode, STRIP_FRAMES)
            caption = (
                f"{name}: seed {row['seed']}, final contact {percent(row['contact_final'])}, flat area "
                f"{row['flat_area_final']:.3f}, {row['stopped_by']}"
            )
            if drawable(episode):
                yield FrameStrip(
                    frames=painter.frame_strip(episode, step_indices, STRIP_WIDTH), tag=policy, caption=caption
                )
                if videos:
                    frames = partial(painter.film, episode, FILM_WIDTH)
                    yield VideoBlock(frames=frames, fps=1.0 / episode.step_s, tag=policy, caption=caption)


def _section(
    results: ResultsLike, painter: EpisodeRenderer, condition: Mapping[str, str], rows: pd.DataFrame, videos: bool
) -> Section:
    words = f"{condition['robot']}, {condition['cloth']}, " + (
        "undisturbed" if condition["disturbance"] == "none" else f"disturbance {condition['disturbance']}"
    )
    policies, reference = policies_of(rows), reference_of(rows)
    pairs = [(policy, reference) for policy in policies if policy != reference]
    quantity = "contact_final" if condition["disturbance"] == "none" else "gain"
    blocks: list[Block | None] = [TableBlock(table=group_table(rows), note=GROUP_NOTE)]
    if pairs:
        lines = [difference_sentence(a, b, quantity, compared(rows, a, b, quantity)) for a, b in pairs]
        note = "Differences over the same starts and disturbances."
        blocks += [
            Text(lines=tuple(lines), finding=True),
            TableBlock(table=paired_table(rows, pairs), title="Paired differences", note=note),
        ]
    blocks += [moment_boxes(rows), contact_curves(rows, lambda run: charts.curve_of(results.episode(run)))]
    blocks += example_strips(results, painter, rows, videos=videos)
    lead = f"Seeds {_span(rows['seed'])}; {len(rows)} episodes."
    id = re.sub(r"[^a-z0-9]+", "-", words.lower()).strip("-")
    return Section(
        id=id, title=words[0].upper() + words[1:], lead=lead, blocks=tuple(b for b in blocks if b is not None)
    )


def _failures(rows: pd.DataFrame) -> Section:
    table = failed_table(rows)
    block: Block = (
        TableBlock(
            table=table,
            note="An episode is listed once, under the first that holds of: crashed, diverged, interrupted, cut off, "
            "not flat.",
        )
        if table.rows
        else Text(lines=("Nothing: every episode ended flat, by its own decision.",))
    )
    return Section(id="failed", title="What failed, and why", blocks=(block,))


def _every(rows: pd.DataFrame) -> Section:
    shown = rows[:ROWS_SHOWN]
    note = "" if len(shown) == len(rows) else f"The first {ROWS_SHOWN} of {len(rows)}; episodes.csv has all."
    return Section(
        id="episodes",
        title="Every episode",
        blocks=(TableBlock(table=every_table(shown), title=f"{len(rows)} episodes", note=note, folded=True),),
    )


def _lead(rows: pd.DataFrame) -> str:
    counts = [
        f"{rows[name].nunique()} {word}" + ("s" if rows[name].nunique() != 1 else "")
        for name, word in (("robot", "robot"), ("cloth", "cloth"))
    ]
    return (
        f"{len(rows)} episodes: {', '.join(policies_of(rows))}; {', '.join(counts)}; disturbances: "
        f"{', '.join(dict.fromkeys(rows['disturbance']))}; seeds {_span(rows['seed'])}."
    )


def _cards(rows: pd.DataFrame) -> Iterator[Card]:
    for policy in policies_of(rows)[:4]:
        group = rows[rows["policy"] == policy]
        final = group["contact_final"].dropna().to_numpy(float)
        gain = (group["contact_final"].astype(float) - group["contact_disturbed"].astype(float)).dropna()
        if len(final):
            below = f"regained {points(gain.mean())} points, n = {len(gain)}" if len(gain) else f"n = {len(final)}"
            yield Card(name=f"{policy}: final contact, mean", value=percent(float(np.mean(final))), below=below)


def _notes(rows: pd.DataFrame) -> Iterator[str]:
    lost = rows[rows["crashed"].astype(bool)]
    if len(lost):
        yield f"{len(lost)} of {len(rows)} episodes crashed and have no numbers; see \u201cWhat failed, and why\u201d."


def _span(seeds: pd.Series) -> str:
    values = sorted({int(seed) for seed in seeds})
    if len(values) > 2 and values == list(range(values[0], values[-1] + 1)):
        return f"{values[0]}\u2013{values[-1]}"
    return ", ".join(map(str, values))
