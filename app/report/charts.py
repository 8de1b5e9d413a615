"""Figures of many episodes, as PNG bytes: contact before, after and final; contact over time with its spread."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from layflat.app.evaluation.phases import phase_spans
from layflat.app.report.figures import DPI, STYLE, colour_of
from layflat.app.support.statistics import confidence_interval
from layflat.data.arrays import FloatArray
from layflat.data.types import Episode

QUARTILES = (25.0, 50.0, 75.0)
JITTER = 0.12
CURVE_STEPS = 600
"""Steps of an episode that a curve keeps at most: 60 s of simulated time."""


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Camera contact (0..1) of one episode over time."""

    time_s: FloatArray
    """(T + 1,), 0 when placing ended, or at the first step where the episode has no disturbance."""
    contact: FloatArray
    spans_s: tuple[tuple[float, float], ...]
    """Begin and end of each disturbance."""


def curve_of(episode: Episode) -> Curve:
    """What a figure keeps of an episode, a few kilobytes."""
    parts = [part for part in phase_spans(episode) if part.phase == "disturb"]
    zero = parts[0].first if parts else 0
    step_times = np.arange(len(episode.steps) + 1, dtype=np.float64)
    return Curve(
        time_s=(step_times - zero) * episode.step_s,
        contact=np.clip(episode.contact(), 0.0, 1.0),
        spans_s=tuple(((p.first - zero) * episode.step_s, (p.after - zero) * episode.step_s) for p in parts),
    )


def boxes(groups: Mapping[str, Mapping[str, FloatArray]], *, unit: str = "contact portion (%)") -> bytes:
    """Box plots side by side: ``groups`` is moment -> policy -> values (0..1); every value is a dot.

    Boxes are quartiles, whiskers reach to the furthest value within 1.5 times the box.
    """
    policies = list(dict.fromkeys(policy for group in groups.values() for policy in group))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(10.4, 3.4), layout="constrained")
        axis = figure.subplots()
        width = 0.8 / max(len(policies), 1)
        rng = np.random.default_rng(0)
        for column, group in enumerate(groups.values()):
            for number, policy in enumerate(policies):
                if policy in group and len(group[policy]):
                    place = column + (number - (len(policies) - 1) / 2) * width
                    _draw_box(axis, place, 100 * group[policy], width, colour_of(policy, number), rng)
        for number, policy in enumerate(policies):
            axis.plot([], [], "s", color=colour_of(policy, number), alpha=0.6, label=policy)
        axis.set_xticks(range(len(groups)), list(groups))
        axis.set_xlim(-0.55, len(groups) - 0.45)
        axis.set_ylabel(unit)
        axis.grid(axis="y")
        figure.legend(loc="outside right upper", frameon=False)
        return png(figure)


def _draw_box(
    axis: Axes, place: float, values: FloatArray, width: float, colour: str, rng: np.random.Generator
) -> None:
    axis.boxplot(
        [values], positions=[place], widths=0.8 * width, showfliers=False, patch_artist=True, manage_ticks=False,
        boxprops={"facecolor": colour, "alpha": 0.25, "edgecolor": colour},
        medianprops={"color": colour, "linewidth": 2}, whiskerprops={"color": colour}, capprops={"color": colour},
    )  # fmt: skip
    dots = place + JITTER * width * rng.uniform(-1.5, 1.5, len(values))
    axis.plot(dots, values, ".", color=colour, markersize=4, alpha=0.7, markeredgewidth=0, zorder=3)


def spread_over_time(groups: Mapping[str, Sequence[Curve]]) -> bytes:
    """Median camera contact over time (bold) and the quarter above and below it (band), for each policy.

    Time 0 is the end of placing where the episodes were disturbed. Drawn from when half of the runs have begun; a run
    that has ended keeps its last value: its cloth lies still.
    """
    disturbed = [span for group in groups.values() for curve in group for span in curve.spans_s]
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(10.4, 3.4), layout="constrained")
        axes = list(
            figure.subplots(1, 2 if disturbed else 1, squeeze=False, width_ratios=(1, 1.6) if disturbed else (1,))[0]
        )
        for number, (policy, group) in enumerate(groups.items()):
            if group:
                time_s, quartiles = quartiles_over_time(group)
                for axis in axes:
                    colour = colour_of(policy, number)
                    axis.fill_between(
                        time_s, 100 * quartiles[0], 100 * quartiles[2], color=colour, alpha=0.18, linewidth=0
                    )
                    axis.plot(
                        time_s, 100 * quartiles[1], color=colour, linewidth=2.2, label=f"{policy} (n = {len(group)})"
                    )
        for axis in axes:
            axis.set_xlabel("time since the stop (s)" if disturbed else "time (s)")
            axis.set_ylabel("contact portion (%)")
            axis.grid(axis="y")
            for begin, end in set(disturbed):
                axis.axvspan(begin, end, color="#b3372b", alpha=0.25 / len(set(disturbed)), linewidth=0, zorder=0)
        axes[0].set_title("whole episode")
        axes[0].set_ylim(0, 105)
        if disturbed:
            _zoom(axes[1], groups)
        if any(groups.values()):
            axes[-1].legend(
                loc="lower right", frameon=True, facecolor="white", edgecolor="none", framealpha=0.85, fontsize=8
            )
        return png(figure)


def quartiles_over_time(group: Sequence[Curve]) -> tuple[FloatArray, FloatArray]:
    """Times (T,) s and the quartiles (3, T) of the contact portion, from when half of the runs have begun."""
    step_s = float(np.median(np.diff(group[0].time_s))) if len(group[0].time_s) > 1 else 0.1
    first = float(np.median([curve.time_s[0] for curve in group]))
    grid = np.arange(first, max(curve.time_s[-1] for curve in group) + step_s / 2, step_s)[:CURVE_STEPS]
    known = np.array([np.interp(grid, curve.time_s, curve.contact, left=np.nan) for curve in group])
    there = np.isfinite(known).any(axis=0)
    return grid[there], np.nanpercentile(known[:, there], QUARTILES, axis=0)


def _zoom(axis: Axes, groups: Mapping[str, Sequence[Curve]]) -> None:
    """From shortly before the first disturbance, on the range that the bands cover there."""
    axis.set_title("disturbance and repair")
    axis.set_xlim(-2.0, max((curve.time_s[-1] for group in groups.values() for curve in group), default=1.0))
    lows = []
    for group in groups.values():
        if group:
            time_s, quartiles = quartiles_over_time(group)
            lows.append(100 * quartiles[0][time_s >= 0].min(initial=1.0))
    axis.set_ylim(max(0.0, min(lows, default=6.0) - 6), 102)


Lines: TypeAlias = Mapping[str, Sequence[tuple[float, FloatArray]]]
"""For each name, values (0..1) at numbers."""


def against(panels: Mapping[str, Lines], *, xlabel: str) -> bytes:
    """Means of values against a number, with the 95 % interval of the mean as a bar; a panel for each y label."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(10.4, 3.2), layout="constrained")
        for axis, (ylabel, lines) in zip(
            figure.subplots(1, len(panels), squeeze=False)[0], panels.items(), strict=True
        ):
            for number, (name, points) in enumerate(lines.items()):
                _draw_means(axis, name, points, colour_of(name, number), shift=0.1 * (number - (len(lines) - 1) / 2))
            axis.set_xlabel(xlabel)
            axis.set_ylabel(ylabel)
            axis.grid(axis="y")
        axis.legend(loc="best")
        return png(figure)


def _draw_means(
    axis: Axes, name: str, points: Sequence[tuple[float, FloatArray]], colour: str, *, shift: float
) -> None:
    known = [(at, values) for at, values in points if len(values)]
    x = np.array([at for at, _ in known])
    mean = np.array([100 * values.mean() for _, values in known])
    ends = np.array([100 * np.array(confidence_interval(values)) for _, values in known]).reshape(-1, 2)
    reach = np.nan_to_num(np.abs(np.column_stack([mean - ends[:, 0], ends[:, 1] - mean]))).T
    axis.errorbar(x + shift, mean, yerr=reach, color=colour, marker="o", markersize=4, capsize=2.5, label=name)


def png(figure: Figure) -> bytes:
    """The figure as a file's content; the same figure gives the same bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    return buffer.getvalue()
