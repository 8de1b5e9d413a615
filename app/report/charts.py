"""Figures of many episodes: box plots, contact over time with its spread, and means with intervals."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from layflat.app.media.plot_style import ALERT, CARD, styled_figure, svg_text
from layflat.app.report.blocks import Figure, Key
from layflat.app.report.policies import policy_style
from layflat.app.support.formatting import percent
from layflat.app.support.phases import phase_spans
from layflat.app.support.statistics import describe
from layflat.data.arrays import FloatArray
from layflat.data.types import Episode

PANEL_IN = (4.4, 3.1)
"""Width and height of a panel: a column of a page, or the width of a phone."""
QUARTILES = (25.0, 50.0, 75.0)
MIN_BOX, FEW = 5, 20
"""Number of values from which quartiles are drawn, and up to which dots are large."""
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


@lru_cache(maxsize=256)
def _key_svg(style: tuple[tuple[str, Any], ...]) -> str:
    with styled_figure(0.42, 0.16) as drawing:
        axis = drawing.add_axes((0.0, 0.0, 1.0, 1.0))
        axis.plot([0, 1, 2], [0, 0, 0], markevery=[1], **dict(style))
        drawing.set_layout_engine("none")
        axis.set_axis_off()
        return svg_text(drawing)


def key(name: str, **style: Any) -> Key:
    """Return an entry of a legend for what is drawn in this style."""
    return Key(name, _key_svg(tuple(sorted({"markersize": 5, "linewidth": 2, **style}.items()))))


def policy_keys(policies: Iterable[str], counts: Mapping[str, int] | None = None) -> tuple[Key, ...]:
    """Return the legend of policies, with the numbers of their episodes if these are given."""
    return tuple(key(p + (f" (n = {counts[p]})" if counts else ""), **policy_style(p)) for p in policies)


def box_plots(
    groups: Mapping[str, Mapping[str, FloatArray]], *, title: str = "contact portion (%)", caption: str = ""
) -> Figure:
    """Draw box plots side by side: ``groups`` is moment -> policy -> values (0..1); every value is a dot.

    Boxes are quartiles, whiskers reach to the furthest value within 1.5 times the box; few values have no box.
    """
    policies = list(dict.fromkeys(policy for group in groups.values() for policy in group))
    width = 0.84 / max(len(policies), 1)
    with styled_figure(*PANEL_IN) as drawing:
        axis = drawing.subplots()
        for column, group in enumerate(groups.values()):
            for number, policy in enumerate(policies):
                if policy in group and len(group[policy]):
                    center = column + (number - (len(policies) - 1) / 2) * width
                    _draw_box(axis, center, 100 * group[policy], width, policy_style(policy))
        axis.set_xticks(range(len(groups)), [name.replace(" ", "\n", 1) for name in groups])
        axis.set(xlim=(-0.5, len(groups) - 0.5), title=title)
        panel = _finished(drawing)
    medians = "; ".join(
        f"{moment}: " + ", ".join(f"{policy} {100 * float(np.median(v)):.1f}" for policy, v in group.items() if len(v))
        for moment, group in groups.items()
    )
    return Figure(panels=(panel,), alt=f"{title}, medians. {medians}.", caption=caption, legend=policy_keys(policies))


def _draw_box(axis: Axes, center: float, values: FloatArray, width: float, style: Mapping[str, Any]) -> None:
    color = style["color"]
    if len(values) >= MIN_BOX:
        line = {"color": color}
        axis.boxplot(
            [values], positions=[center], widths=0.84 * width, showfliers=False, patch_artist=True, manage_ticks=False,
            boxprops={"facecolor": color, "alpha": 0.2, "edgecolor": color},
            medianprops={**line, "linewidth": 2.5}, whiskerprops=line, capprops=line,
        )  # fmt: skip
    else:
        # Light, so that a dot that is the median is seen on it.
        ends = center - 0.42 * width, center + 0.42 * width
        axis.hlines(np.median(values), *ends, colors=color, linewidth=2.5, alpha=0.4)
    # Side by side in the order of the episodes, so that equal values do not hide each other.
    dots = center + 0.66 * width * (np.arange(len(values)) + 0.5 - len(values) / 2) / max(len(values), 4)
    size = 7 if len(values) <= FEW else 4
    axis.plot(dots, values, style["marker"], color=color, markersize=size, markeredgecolor=CARD, markeredgewidth=0.6,
              zorder=3)  # fmt: skip


def contact_over_time(groups: Mapping[str, Sequence[Curve]], *, caption: str = "") -> Figure:
    """Draw the median camera contact over time (bold) and its quartiles (band) for each policy.

    Time 0 is the end of placing where the episodes were disturbed. Drawn from when half of the runs have begun; a run
    that has ended keeps its last value, since its cloth lies still.
    """
    bands = {policy: quartiles_over_time(group) for policy, group in groups.items() if group}
    spans = {span for group in groups.values() for curve in group for span in curve.spans_s}
    panels = [_bands_panel(bands, spans, "whole episode", ylim=(0, 105))]
    if spans:  # from shortly before the first disturbance, on the range that the bands cover there
        lows = [100 * quartiles[0][time_s >= 0].min(initial=1.0) for time_s, quartiles in bands.values()]
        last_s = max(curve.time_s[-1] for group in groups.values() for curve in group)
        limits = {"xlim": (-2.0, last_s), "ylim": (max(0.0, min(lows) - 6), 102)}
        panels.append(_bands_panel(bands, spans, "disturbance and repair", **limits))
    ends = ", ".join(f"{policy} {percent(float(quartiles[1, -1]))}" for policy, (_, quartiles) in bands.items())
    legend = policy_keys(bands, {policy: len(group) for policy, group in groups.items()})
    if spans:
        legend += (key("disturbance", color=ALERT, alpha=0.25, linewidth=9),)
    alt = f"Contact portion over time. Medians at the end: {ends or 'none'}."
    return Figure(panels=tuple(panels), alt=alt, caption=caption, legend=legend)


def _bands_panel(
    bands: Mapping[str, tuple[FloatArray, FloatArray]], spans: set[tuple[float, float]], title: str, **limits: Any
) -> str:
    with styled_figure(*PANEL_IN) as drawing:
        axis = drawing.subplots()
        for policy, (time_s, quartiles) in bands.items():
            low, median, high = 100 * quartiles
            style = policy_style(policy)
            axis.fill_between(time_s, low, high, color=style["color"], alpha=0.16, linewidth=0)
            axis.plot(time_s, median, linewidth=2.2, markersize=5, markevery=0.19, **style)
        for begin, end in spans:
            axis.axvspan(begin, end, color=ALERT, alpha=0.25 / len(spans), linewidth=0, zorder=0)
        xlabel = "time since the stop (s)" if spans else "time (s)"
        axis.set(title=f"contact portion (%), {title}", xlabel=xlabel, **limits)
        return _finished(drawing)


def _finished(drawing: Drawing) -> str:
    for axis in drawing.axes:
        axis.grid(axis="y")
        axis.set_axisbelow(True)
    return svg_text(drawing)


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


def means_against(panels: Mapping[str, Lines], *, xlabel: str, caption: str = "") -> Figure:
    """Draw means of samples against a number, with their 95 % intervals as bars; one panel for each title."""
    names = list(dict.fromkeys(name for lines in panels.values() for name in lines))
    drawn = tuple(_means_panel(title, lines, xlabel) for title, lines in panels.items())
    return Figure(panels=drawn, alt=f"{' and '.join(panels)} against {xlabel}.", caption=caption,
                  legend=policy_keys(names))  # fmt: skip


def _means_panel(title: str, lines: Lines, xlabel: str) -> str:
    with styled_figure(*PANEL_IN) as drawing:
        axis = drawing.subplots()
        for number, (name, samples) in enumerate(lines.items()):
            shift = 0.1 * (number - (len(lines) - 1) / 2)
            _draw_means(axis, name, [(x + shift, values) for x, values in samples])
        axis.set(xlabel=xlabel, title=title)
        return _finished(drawing)


def _draw_means(axis: Axes, name: str, samples: Sequence[tuple[float, FloatArray]]) -> None:
    known = [(x, describe(100 * values)) for x, values in samples if len(values)]
    reach = np.nan_to_num([[s.mean - s.low, s.high - s.mean] for _, s in known]).reshape(-1, 2).T
    axis.errorbar(
        [x for x, _ in known], [s.mean for _, s in known], yerr=np.abs(reach),
        markersize=5, capsize=2.5, **policy_style(name),
    )  # fmt: skip


class Scatter(NamedTuple):
    """Episodes against a number, by policy."""

    dots: Mapping[str, FloatArray]
    """Number and contact portion (0..1) of each episode, (n, 2)."""
    bins: Lines
    """Contact portions (0..1) of the episodes around some numbers."""
    ticks: Sequence[str] = ()
    """Names of the numbers 0, 1, ..., where they stand for words."""


def scatters_with_means(panels: Mapping[str, Scatter], *, caption: str = "") -> Figure:
    """Draw episodes as dots, and means of bins of them with their 95 % intervals; one panel for each label of x."""
    names = list(dict.fromkeys(name for panel in panels.values() for name in panel.dots))
    means = (
        f"{xlabel}, {name}: " + ", ".join(f"{x:.3g}: {percent(float(found.mean()))}" for x, found in bins if len(found))
        for xlabel, panel in panels.items()
        for name, bins in panel.bins.items()
    )
    return Figure(
        panels=tuple(_scatter_panel(xlabel, panel) for xlabel, panel in panels.items()),
        alt=f"Final contact portion, means. {'; '.join(means)}.",
        caption=caption,
        legend=policy_keys(names),
    )


def _scatter_panel(xlabel: str, panel: Scatter) -> str:
    with styled_figure(*PANEL_IN) as drawing:
        axis = drawing.subplots()
        for name, points in panel.dots.items():
            style = policy_style(name)
            axis.plot(*(points * (1, 100)).T, style["marker"], color=style["color"], markersize=4, alpha=0.35)
        for name, bins in panel.bins.items():
            _draw_means(axis, name, bins)
        if panel.ticks:
            axis.set_xticks(range(len(panel.ticks)), list(panel.ticks))
        axis.set(xlabel=xlabel, title="final contact portion (%)")
        return _finished(drawing)
