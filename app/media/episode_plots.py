"""A page of plots of a session: paths in the xz plane, starts, actions, contact portion and WORD over time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from layflat.app.media.plot_style import ALERT, MUTED, SERIES, legend_below, png_bytes, styled_figure
from layflat.app.support.phases import disturbed_spans
from layflat.data.arrays import FloatArray
from layflat.data.atomic_files import atomic_path
from layflat.data.robot import RobotSpec
from layflat.data.types import OUTCOMES, Episode, Outcome, actions_of

OUTCOME_COLORS: Mapping[Outcome, str] = {"success": SERIES[1], "failure": SERIES[0], "partial": SERIES[2]}
AXIS_COLORS: Mapping[str, str] = {"x": SERIES[3], "y": SERIES[5], "z": SERIES[4]}
LINE_STYLES = ("-", "--")
"""Of the first and the second picker."""
INTERVENTION_COLOR = "#f2c14e"
THIN, THICK = 0.8, 2.2
CROWD = 12
"""Number of curves above which each is drawn fainter."""


@dataclass(frozen=True, kw_only=True)
class EpisodeCurves:
    """Time series of one episode, with T steps."""

    name: str
    robot: RobotSpec
    outcome: Outcome
    time_s: FloatArray
    """(T + 1,) s, 0 at the first step."""
    disturbances_s: tuple[float, ...]
    """Beginning of each disturbance."""
    pulls_s: tuple[float, ...]
    """Beginning of each pull by a person at the cloth."""
    interventions_s: tuple[tuple[float, float], ...]
    """Beginning and end of each intervention."""
    corners_m: FloatArray
    """(T + 1, 2, 3)"""
    holder_m: FloatArray
    """(T + 1, 3)"""
    actions_m: FloatArray
    """(T, A)"""
    contact: FloatArray
    """(T + 1,)"""
    word_deg: FloatArray
    """(T + 1,) direction of WORD, 0 along +x; NaN where there is none."""


def curves_of(name: str, episode: Episode) -> EpisodeCurves:
    """Extract the plotted part of an episode, so that thousands fit into memory."""
    step_s, seen = episode.step_s, episode.observations()
    word = np.array([o.word for o in seen])
    pulled = [-1 if step.drag is None else step.drag.node for step in episode.steps]
    pull_begins = [k for k, node in enumerate(pulled) if node >= 0 and (k == 0 or pulled[k - 1] != node)]
    taken = [False, *(step.intervention for step in episode.steps), False]
    interventions = np.flatnonzero(np.diff(taken)).reshape(-1, 2)
    return EpisodeCurves(
        name=name,
        robot=episode.robot,
        outcome=episode.outcome,
        time_s=step_s * np.arange(len(seen), dtype=np.float64),
        disturbances_s=tuple(step_s * first for first, _ in disturbed_spans(episode)),
        pulls_s=tuple(step_s * k for k in pull_begins),
        interventions_s=tuple((step_s * int(first), step_s * int(end)) for first, end in interventions),
        corners_m=np.array([o.corner_positions for o in seen]),
        holder_m=np.array([o.holder_position for o in seen]),
        actions_m=actions_of(episode.steps),
        contact=episode.contact(),
        word_deg=np.where(word.any(axis=1), np.degrees(np.arctan2(word[:, 1], word[:, 0])), np.nan),
    )


def align_curves(episodes: Sequence[EpisodeCurves]) -> tuple[list[EpisodeCurves], bool]:
    """Shift time 0 to the first disturbance if every episode has one; the second value is whether it was shifted."""
    if not all(curves.disturbances_s for curves in episodes):
        return list(episodes), False
    return [_shifted(curves, -curves.disturbances_s[0]) for curves in episodes], True


def _shifted(curves: EpisodeCurves, by_s: float) -> EpisodeCurves:
    return replace(
        curves,
        time_s=curves.time_s + by_s,
        disturbances_s=tuple(moment + by_s for moment in curves.disturbances_s),
        pulls_s=tuple(moment + by_s for moment in curves.pulls_s),
        interventions_s=tuple((first + by_s, end + by_s) for first, end in curves.interventions_s),
    )


def plot_session(path: Path, title: str, episodes: Iterable[EpisodeCurves]) -> int:
    """Draw the page into a PNG at ``path``, whole or not at all; return the number of episodes on it."""
    all_curves, aligned = align_curves(list(episodes))
    with styled_figure(12.0, 7.2) as figure:
        figure.suptitle(title, x=0.01, ha="left", fontsize=10.5)
        panels = figure.subplot_mosaic([["paths", "paths", "starts"], ["actions", "contact", "word"]])
        _draw_paths(panels["paths"], all_curves)
        _draw_starts(panels["starts"], all_curves)
        _draw_actions(panels["actions"], all_curves)
        _draw_contact(panels["contact"], all_curves)
        _draw_word(panels["word"], all_curves)
        panels["word"].set_xlim(panels["contact"].get_xlim())
        for key in ("actions", "contact", "word"):
            panels[key].set_xlabel("time since the disturbance began (s)" if aligned else "time (s)")
            panels[key].grid(axis="y")
            _mark_events(panels[key], all_curves, named=key == "contact")
        with atomic_path(path) as aside:
            aside.write_bytes(png_bytes(figure))
    return len(all_curves)


def _mark_events(axis: Axes, episodes: Sequence[EpisodeCurves], *, named: bool) -> None:
    """Mark disturbances, pulls and interventions."""
    disturbances = {moment for curves in episodes for moment in curves.disturbances_s}
    pulls = {moment for curves in episodes for moment in curves.pulls_s}
    interventions = {span for curves in episodes for span in curves.interventions_s}
    for moments, style, name in ((disturbances, "-", "disturbance"), (pulls, ":", "pulled by hand")):
        for number, moment_s in enumerate(sorted(moments)):
            label = None if number else name
            alpha = _alpha(len(moments))
            axis.axvline(moment_s, color=ALERT, linestyle=style, linewidth=1, alpha=alpha, zorder=0, label=label)
    for number, (first, end) in enumerate(sorted(interventions)):
        alpha, label = 0.5 * _alpha(len(interventions)), None if number else "a person decides"
        axis.axvspan(first, end, color=INTERVENTION_COLOR, alpha=alpha, zorder=0, linewidth=0, label=label)
    if named and (disturbances or pulls or interventions):
        legend_below(axis, 3)


def _alpha(count: int) -> float:
    return float(np.clip(CROWD / max(count, 1), 0.15, 0.9))


def _draw_paths(axis: Axes, episodes: Sequence[EpisodeCurves]) -> None:
    """Draw the paths of the hanger, or of both pickers, in the xz plane."""
    for curves in episodes:
        tracks = [curves.holder_m] if curves.robot.n_points == 1 else [curves.corners_m[:, 0], curves.corners_m[:, 1]]
        for track, style in zip(tracks, LINE_STYLES, strict=False):
            color = OUTCOME_COLORS[curves.outcome]
            axis.plot(track[:, 0], track[:, 2], style, color=color, linewidth=THIN + 0.3, alpha=_alpha(len(episodes)))
            axis.plot(track[0, 0], track[0, 2], "o", color=color, markersize=4)
            axis.plot(track[-1, 0], track[-1, 2], "s", color=color, markersize=4)
    for outcome in OUTCOMES:
        count = sum(curves.outcome == outcome for curves in episodes)
        if count:
            axis.plot([], [], color=OUTCOME_COLORS[outcome], label=f"{outcome} ({count})")
    if any(curves.robot.n_points > 1 for curves in episodes):
        axis.plot([], [], "--", color=MUTED, label="picker 2")
    axis.plot([], [], "o", color=MUTED, markersize=4, label="start")
    axis.plot([], [], "s", color=MUTED, markersize=4, label="end")
    legend_below(axis, 6)
    axis.set(title="paths in the xz plane", xlabel="x (m)", ylabel="z (m)")
    axis.set_aspect("equal", adjustable="datalim")


def _draw_starts(axis: Axes, episodes: Sequence[EpisodeCurves]) -> None:
    """Draw the holder's start positions; the cross is their mean with one standard deviation to each side."""
    starts = 1000 * np.array([curves.holder_m[0, [0, 2]] for curves in episodes])
    colors = [OUTCOME_COLORS[curves.outcome] for curves in episodes]
    axis.scatter(starts[:, 0], starts[:, 1], s=22, c=colors, linewidths=0, alpha=0.8)
    mean, spread = starts.mean(axis=0), starts.std(axis=0)
    axis.errorbar(mean[0], mean[1], xerr=spread[0], yerr=spread[1], color=MUTED, linewidth=1.2, capsize=3)
    title = f"starts: {spread[0]:.0f} mm and {spread[1]:.0f} mm standard deviation"
    axis.set(title=title, xlabel="x (mm)", ylabel="z (mm)")
    axis.margins(0.15)
    axis.locator_params(axis="x", nbins=5)


def _draw_actions(axis: Axes, episodes: Sequence[EpisodeCurves]) -> None:
    for column, name in enumerate(episodes[0].robot.action_names):
        tracks = [(curves.time_s[:-1], 1000 * curves.actions_m[:, column]) for curves in episodes]
        _draw_tracks(axis, tracks, AXIS_COLORS[name[1]], LINE_STYLES[name.endswith("2")], label=name)
    axis.set(title="actions", ylabel="displacement (mm per step)")
    legend_below(axis, 3)


def _draw_contact(axis: Axes, episodes: Sequence[EpisodeCurves]) -> None:
    for outcome in OUTCOMES:
        tracks = [(curves.time_s, 100 * curves.contact) for curves in episodes if curves.outcome == outcome]
        if tracks:
            _draw_tracks(axis, tracks, OUTCOME_COLORS[outcome], "-", label=outcome)
    axis.set(ylim=(0, 105), title="contact portion, as the camera sees it", ylabel="contact portion (%)")


def _draw_word(axis: Axes, episodes: Sequence[EpisodeCurves]) -> None:
    """Draw dots, not lines: the direction may jump, and half of the time there is none."""
    alpha = _alpha(len(episodes))
    for curves in episodes:
        color = OUTCOME_COLORS[curves.outcome]
        axis.plot(curves.time_s, curves.word_deg, ".", color=color, markersize=3, alpha=alpha, markeredgewidth=0)
    axis.set(ylim=(-95, 95), title="WORD", ylabel="direction (degrees from +x)")
    axis.set_yticks([-90, -45, 0, 45, 90])


def _draw_tracks(
    axis: Axes, tracks: Sequence[tuple[FloatArray, FloatArray]], color: str, style: str, *, label: str
) -> None:
    """Draw each track thin and, where there are several, the mean over those that have not ended in bold."""
    if len(tracks) == 1:
        axis.plot(*tracks[0], style, color=color, linewidth=1.4, label=label)
        return
    for time_s, values in tracks:
        axis.plot(time_s, values, style, color=color, linewidth=THIN, alpha=0.6 * _alpha(len(tracks)))
    step_s = float(np.median(np.diff(tracks[0][0]))) if len(tracks[0][0]) > 1 else 0.1
    first, last = min(time_s[0] for time_s, _ in tracks), max(time_s[-1] for time_s, _ in tracks)
    grid = np.arange(first, last + step_s / 2, step_s)
    known = np.array([np.interp(grid, *track, left=np.nan, right=np.nan) for track in tracks])
    present = np.isfinite(known).any(axis=0)
    mean = np.nanmean(known[:, present], axis=0)
    axis.plot(grid[present], mean, style, color=color, linewidth=THICK, label=label)
