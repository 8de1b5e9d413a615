"""Figures of many episodes, as PNG bytes: box plots, contact over time with its spread, and means with intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from matplotlib.axes import Axes

from layflat.app.media.plot_style import ALERT, BOXED_LEGEND, png_bytes, styled_figure
from layflat.app.report.policies import policy_color
from layflat.app.support.phases import phase_spans
from layflat.app.support.statistics import describe
from layflat.data.arrays import FloatArray
from layflat.data.types import Episode

WIDTH_IN = 10.4
QUARTILES = (25.0, 50.0, 75.0)
JITTER = 0.12
CURVE_STEPS = 600
"""Steps of an episode that a curve keeps at most: 60 s of simulated time."""


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Camera contact portion (0..1) of one episode over time."""

    time_s: FloatArray
    """(T + 1,), 0 at the beginning of the first phase ``disturb``, or at the first step of an undisturbed episode."""
    contact: FloatArray
    spans_s: tuple[tuple[float, float], ...]
    """Beginning and end of each phase ``disturb``."""


def curve_of(episode: Episode) -> Curve:
    """Extract the curve of an episode: a few kilobytes."""
    spans = [span for span in phase_spans(episode) if span.phase == "disturb"]
    zero = spans[0].first if spans else 0
    return Curve(
        time_s=(np.arange(len(episode.steps) + 1, dtype=np.float64) - zero) * episode.step_s,
        contact=np.clip(episode.contact(), 0.0, 1.0),
        spans_s=tuple(((span.first - zero) * episode.step_s, (span.end - zero) * episode.step_s) for span in spans),
    )


def box_plots(groups: Mapping[str, Mapping[str, FloatArray]], *, ylabel: str = "contact portion (%)") -> bytes:
    """Draw box plots side by side: ``groups`` is moment -> policy -> values (0..1); every value is a dot.

    Boxes are quartiles, whiskers reach to the furthest value within 1.5 times the box.
    """
    policies = list(dict.fromkeys(policy for group in groups.values() for policy in group))
    width = 0.8 / max(len(policies), 1)
    rng = np.random.default_rng(0)
    with styled_figure(WIDTH_IN, 3.4) as figure:
        axis = figure.subplots()
        for column, group in enumerate(groups.values()):
            for number, policy in enumerate(policies):
                if policy in group and len(group[policy]):
                    center = column + (number - (len(policies) - 1) / 2) * width
                    _draw_box(axis, center, 100 * group[policy], width, policy_color(policy, number), rng)
        for number, policy in enumerate(policies):
            axis.plot([], [], "s", color=policy_color(policy, number), alpha=0.6, label=policy)
        axis.set_xticks(range(len(groups)), list(groups))
        axis.set(xlim=(-0.55, len(groups) - 0.45), ylabel=ylabel)
        axis.grid(axis="y")
        figure.legend(loc="outside right upper")
        return png_bytes(figure)


def _draw_box(
    axis: Axes, center: float, values: FloatArray, width: float, color: str, rng: np.random.Generator
) -> None:
    line = {"color": color}
    axis.boxplot(
        [values], positions=[center], widths=0.8 * width, showfliers=False, patch_artist=True, manage_ticks=False,
        boxprops={"facecolor": color, "alpha": 0.25, "edgecolor": color},
        medianprops={**line, "linewidth": 2}, whiskerprops=line, capprops=line,
    )  # fmt: skip
    dots = center + JITTER * width * rng.uniform(-1.5, 1.5, len(values))
    axis.plot(dots, values, ".", color=color, markersize=4, alpha=0.7, markeredgewidth=0, zorder=3)


def contact_over_time(groups: Mapping[str, Sequence[Curve]]) -> bytes:
    """Draw the median camera contact over time (bold) and its quartiles (band) for each policy.

    Time 0 is the end of placing where the episodes were disturbed. Drawn from when half of the runs have begun; a run
    that has ended keeps its last value, since its cloth lies still.
    """
    bands = {policy: quartiles_over_time(group) for policy, group in groups.items() if group}
    spans = {span for group in groups.values() for curve in group for span in curve.spans_s}
    with styled_figure(WIDTH_IN, 3.4) as figure:
        ratios = (1, 1.6) if spans else (1,)
        axes = list(figure.subplots(1, len(ratios), squeeze=False, width_ratios=ratios)[0])
        for axis in axes:
            for number, policy in enumerate(groups):
                if policy in bands:
                    label = f"{policy} (n = {len(groups[policy])})"
                    _draw_band(axis, *bands[policy], policy_color(policy, number), label)
            axis.set(xlabel="time since the stop (s)" if spans else "time (s)", ylabel="contact portion (%)")
            axis.grid(axis="y")
            for begin, end in spans:
                axis.axvspan(begin, end, color=ALERT, alpha=0.25 / len(spans), linewidth=0, zorder=0)
        axes[0].set(title="whole episode", ylim=(0, 105))
        if spans:  # from shortly before the first disturbance, on the range that the bands cover there
            lows = [100 * quartiles[0][time_s >= 0].min(initial=1.0) for time_s, quartiles in bands.values()]
            last_s = max(curve.time_s[-1] for group in groups.values() for curve in group)
            axes[1].set(title="disturbance and repair", xlim=(-2.0, last_s), ylim=(max(0.0, min(lows) - 6), 102))
        if bands:
            axes[-1].legend(loc="lower right", **BOXED_LEGEND)
        return png_bytes(figure)


def _draw_band(axis: Axes, time_s: FloatArray, quartiles: FloatArray, color: str, label: str) -> None:
    low, median, high = 100 * quartiles
    axis.fill_between(time_s, low, high, color=color, alpha=0.18, linewidth=0)
    axis.plot(time_s, median, color=color, linewidth=2.2, label=label)


def quartiles_over_time(group: Sequence[Curve]) -> tuple[FloatArray, FloatArray]:
    """Return times (T,) s and the quartiles (3, T) of the contact portion, from when half of the runs have begun."""
    step_s = float(np.median(np.diff(group[0].time_s))) if len(group[0].time_s) > 1 else 0.1
    first = float(np.median([curve.time_s[0] for curve in group]))
    grid = np.arange(first, max(curve.time_s[-1] for curve in group) + step_s / 2, step_s)[:CURVE_STEPS]
    known = np.array([np.interp(grid, curve.time_s, curve.contact, left=np.nan) for curve in group])
    present = np.isfinite(known).any(axis=0)
    return grid[present], np.nanpercentile(known[:, present], QUARTILES, axis=0)


Lines: TypeAlias = Mapping[str, Sequence[tuple[float, FloatArray]]]
"""For each name, samples of values (0..1) at numbers."""


def means_against(panels: Mapping[str, Lines], *, xlabel: str) -> bytes:
    """Draw means of samples against a number, with their 95 % intervals as bars; one panel for each y label."""
    with styled_figure(WIDTH_IN, 3.2) as figure:
        axes = figure.subplots(1, len(panels), squeeze=False)[0]
        for axis, (ylabel, lines) in zip(axes, panels.items(), strict=True):
            for number, (name, samples) in enumerate(lines.items()):
                shift = 0.1 * (number - (len(lines) - 1) / 2)
                known = [(x + shift, describe(100 * values)) for x, values in samples if len(values)]
                reach = np.nan_to_num([[s.mean - s.low, s.high - s.mean] for _, s in known]).reshape(-1, 2).T
                axis.errorbar(
                    [x for x, _ in known], [s.mean for _, s in known], yerr=np.abs(reach),
                    color=policy_color(name, number), marker="o", markersize=4, capsize=2.5, label=name,
                )  # fmt: skip
            axis.set(xlabel=xlabel, ylabel=ylabel)
            axis.grid(axis="y")
        axes[-1].legend(loc="best")
        return png_bytes(figure)
