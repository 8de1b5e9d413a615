"""The thesis's Tables 4-1 and 4-2, and ours beside them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from layflat.app.report import thesis_numbers
from layflat.app.report.thesis_numbers import BASELINE, PROPOSED
from layflat.app.support.metrics import disturbed_step, episode_metrics, placed_step
from layflat.app.support.statistics import statistics
from layflat.data.arrays import FloatArray
from layflat.data.types import FLAT_AREA, Episode

THESIS_PLACING, THESIS_DISTURBANCE = thesis_numbers.PLACING, thesis_numbers.DISTURBANCE


@dataclass(frozen=True)
class Table:
    """Cells as text; the first column is left-aligned. ``ours`` marks the rows that this program made."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    ours: tuple[bool, ...]


def order(policies: Mapping[str, object]) -> list[str]:
    """The baseline, the proposed method, then the others as given."""
    first = [name for name in (BASELINE, PROPOSED) if name in policies]
    return first + [name for name in policies if name not in first]


def placing_table(runs: Mapping[str, Sequence[Episode]]) -> Table:
    """Table 4-1: contact portion at the end of placing; ours with spread, mesh contact and flat area at that moment."""
    header = ("", "n", "max", "mean", "min", "95 % CI of mean", "mesh contact", "flat area (min)", "flat", "unstable")
    lines: list[tuple[str, ...]] = []
    for policy in order(runs):
        if policy in THESIS_PLACING:
            top, mean, least = THESIS_PLACING[policy]
            lines.append((f"{policy}, thesis", "", percent(top), percent(mean), percent(least), *[""] * 5))
        lines.append((policy, *_placing_cells(runs[policy])))
    return Table(header, tuple(lines), tuple("thesis" not in line[0] for line in lines))


def disturbance_table(runs: Mapping[str, Sequence[Episode]]) -> Table:
    """Table 4-2: contact portion after placing, after the disturbance and final, over the runs that were disturbed."""
    header = (
        "",
        "n",
        "after placing",
        "after disturbance",
        "final",
        "regained (points)",
        "95 % CI",
        "mesh contact",
        "flat area",
    )
    lines: list[tuple[str, ...]] = []
    for policy in order(runs):
        for number, cells in enumerate(THESIS_DISTURBANCE.get(policy, ()), start=1):
            gained = points(cells[2] - cells[1])
            lines.append((f"{policy}, thesis {number}", "", *map(percent, cells), gained, "", "", ""))
        disturbed = [run for run in runs[policy] if disturbed_step(run) is not None]
        if disturbed:
            lines.append((policy, *_disturbance_cells(disturbed)))
    return Table(header, tuple(lines), tuple("thesis" not in line[0] for line in lines))


def seeds_table(runs: Mapping[str, Sequence[Episode]]) -> Table:
    """One row per run, nothing left out."""
    header = (
        "policy", "seed", "disturbance", "placed", "disturbed", "final", "regained", "mesh contact", "flat area",
        "steps", "stopped by", "simulated", "wall",
    )  # fmt: skip
    lines = []
    for policy in order(runs):
        for run in runs[policy]:
            row = episode_metrics(run)
            lines.append(
                (
                    policy,
                    str(row["seed"]),
                    row["disturbance"],
                    percent(row["contact_placed"]),
                    percent(row["contact_disturbed"]),
                    percent(row["contact_final"]),
                    points(gain_of(run)),
                    percent(row["contact_final_true"]),
                    ratio(row["flat_area_final"]),
                    str(row["steps"]),
                    row["stopped_by"],
                    f"{row['sim_s']:.1f} s",
                    f"{row['wall_s']:.1f} s",
                )
            )
    return Table(header, tuple(lines), (True,) * len(lines))


def gain_of(episode: Episode) -> float | None:
    """Contact portion regained after the disturbance, or None where there was none."""
    row = episode_metrics(episode)
    return None if row["contact_disturbed"] is None else float(row["contact_final"] - row["contact_disturbed"])


def placed_contacts(runs: Sequence[Episode]) -> FloatArray:
    """Camera contact portion at the end of placing, of the runs that got so far."""
    return np.array([row["contact_placed"] for row in map(episode_metrics, runs) if row["contact_placed"] is not None])


def gains(runs: Sequence[Episode]) -> FloatArray:
    """Regained contact portion of the disturbed runs."""
    return np.array([gain for gain in map(gain_of, runs) if gain is not None])


def flat_count(episodes: Sequence[Episode]) -> int:
    """Episodes that end flat."""
    return sum(truth is not None and truth.flat_area > FLAT_AREA for truth in (e.final_ground_truth for e in episodes))


def seeds_text(episodes: Sequence[Episode]) -> str:
    """Seeds for a person: "0-9", "3, 5, 8"."""
    seeds = sorted({episode.seed for episode in episodes})
    if len(seeds) > 2 and seeds == list(range(seeds[0], seeds[-1] + 1)):
        return f"{seeds[0]}\u2013{seeds[-1]}"
    return ", ".join(map(str, seeds))


def percent(value: float | None) -> str:
    """0.9651 -> "96.5 %"; a dash where there is no value."""
    return "\u2013" if value is None or math.isnan(value) else f"{100 * value:.1f} %"


def points(value: float | None) -> str:
    """Percentage points with their sign."""
    return "\u2013" if value is None or math.isnan(value) else f"{100 * value:+.1f}".replace("-", "\u2212")


def ratio(value: float) -> str:
    return f"{value:.3f}".replace("-", "\u2212")


def interval(low: float, high: float, form: str) -> str:
    """A confidence interval; a dash where fewer than two values leave none."""
    return (
        "\u2013"
        if math.isnan(low)
        else f"{format(100 * low, form)} to {format(100 * high, form)}".replace("-", "\u2212")
    )


def _placing_cells(runs: Sequence[Episode]) -> tuple[str, ...]:
    ends = [(run, end) for run, end in ((run, placed_step(run)) for run in runs) if end is not None]
    contact = statistics(placed_contacts(runs))
    ground_truths = [run.ground_truths()[end] for run, end in ends]
    area = statistics(np.array([ground_truth.flat_area for ground_truth in ground_truths]))
    mesh = statistics(np.array([ground_truth.contact_portion_true for ground_truth in ground_truths]))
    flat = sum(ground_truth.flat_area > FLAT_AREA for ground_truth in ground_truths)
    return (
        str(len(ends)),
        percent(contact["max"]),
        percent(contact["mean"]),
        percent(contact["min"]),
        interval(contact["low"], contact["high"], ".1f"),
        percent(mesh["mean"]),
        f"{area['mean']:.3f} ({ratio(area['min'])})",
        f"{flat}/{len(ends)}",
        str(sum(run.unstable for run in runs)),
    )


def _disturbance_cells(runs: Sequence[Episode]) -> tuple[str, ...]:
    rows = [episode_metrics(run) for run in runs]
    gain = statistics(gains(runs))

    def mean(name: str) -> float:
        return float(np.mean([row[name] for row in rows if row[name] is not None]))

    return (
        str(len(runs)),
        percent(mean("contact_placed")),
        percent(mean("contact_disturbed")),
        percent(mean("contact_final")),
        points(gain["mean"]),
        interval(gain["low"], gain["high"], "+.1f"),
        percent(mean("contact_final_true")),
        ratio(mean("flat_area_final")),
    )
