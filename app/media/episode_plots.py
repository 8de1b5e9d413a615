"""A page of plots of a session: paths in the xz plane, starts, actions, contact portion and WORD over time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from layflat.app.report.figures import DPI, MUTED, STYLE
from layflat.app.support.atomic_write import atomic_write
from layflat.app.support.metrics import disturbed_spans
from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec
from layflat.data.types import OUTCOMES, Episode, Outcome, actions_of

COLOURS: Mapping[Outcome, str] = {"success": "#0f766e", "failure": "#c2571a", "partial": "#6d5bd0"}
AXIS_COLOURS: Mapping[str, str] = {"x": "#0369a1", "y": "#4d7c0f", "z": "#b8336a"}
LINE_STYLES = ("-", "--")
"""Of the first and the second picker."""
MARK_COLOUR, PERSON_COLOUR = "#b3372b", "#f2c14e"
THIN, THICK = 0.8, 2.2
CROWD = 12
"""From so many curves on each is drawn fainter."""


@dataclass(frozen=True, kw_only=True)
class Curves:
    """What is drawn of one episode."""

    name: str
    robot: RobotSpec
    outcome: Outcome
    time_s: FloatArray
    """(T + 1,) s, 0 at the first step."""
    disturbances_s: tuple[float, ...]
    """When each disturbance began."""
    pulls_s: tuple[float, ...]
    """When a person took hold of the cloth."""
    interventions_s: tuple[tuple[float, float], ...]
    """From when to when a person decided although a policy had the lead."""
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

    @property
    def disturbed_s(self) -> float | None:
        """When the first disturbance began, where there is one."""
        return self.disturbances_s[0] if self.disturbances_s else None


def curves_of(name: str, episode: Episode) -> Curves:
    """The episode without what no plot shows, so that thousands fit into memory."""
    seen = episode.observations()
    word = np.array([o.word for o in seen])
    angle = np.degrees(np.arctan2(word[:, 1], word[:, 0]))
    held = [-1 if step.pull is None else step.pull.node for step in episode.steps]
    pulled = [
        step_index
        for step_index, node in enumerate(held)
        if node >= 0 and (step_index == 0 or held[step_index - 1] != node)
    ]
    taken = _runs([step.intervention for step in episode.steps])
    return Curves(
        name=name,
        robot=episode.robot,
        outcome=episode.outcome,
        time_s=episode.step_s * np.arange(len(seen), dtype=np.float64),
        disturbances_s=tuple(episode.step_s * begun for begun, _ in disturbed_spans(episode)),
        pulls_s=tuple(episode.step_s * step_index for step_index in pulled),
        interventions_s=tuple((episode.step_s * first, episode.step_s * end) for first, end in taken),
        corners_m=np.array([o.corner_positions for o in seen]),
        holder_m=np.array([o.holder_position for o in seen]),
        actions_m=actions_of(episode.steps),
        contact=episode.contact(),
        word_deg=np.where(word.any(axis=1), angle, np.nan),
    )


def _runs(marked: Sequence[bool]) -> list[tuple[int, int]]:
    """First step of each unbroken series that is marked, and the step after its last."""
    edges = np.flatnonzero(np.diff([False, *marked, False]))
    return [(int(first), int(end)) for first, end in edges.reshape(-1, 2)]


def aligned_curves(episodes: Sequence[Curves]) -> tuple[list[Curves], bool]:
    """Curves whose time 0 is the beginning of the first disturbance, if all of them have one; and whether it is."""
    if not all(curves.disturbed_s is not None for curves in episodes):
        return list(episodes), False
    return [_later(curves, -(curves.disturbed_s or 0.0)) for curves in episodes], True


def _later(curves: Curves, by_s: float) -> Curves:
    return replace(
        curves,
        time_s=curves.time_s + by_s,
        disturbances_s=tuple(moment + by_s for moment in curves.disturbances_s),
        pulls_s=tuple(moment + by_s for moment in curves.pulls_s),
        interventions_s=tuple((first + by_s, end + by_s) for first, end in curves.interventions_s),
    )


def plot_session(path: Path, title: str, episodes: Iterable[Curves]) -> int:
    """Draw the page into a PNG at ``path``, whole or not at all; returns the number of episodes on it."""
    all_curves, aligned = aligned_curves(list(episodes))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(12.0, 7.2), layout="constrained")
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
            _mark(panels[key], all_curves, named=key == "contact")
        with atomic_write(path) as aside:
            figure.savefig(aside, format="png", dpi=DPI, metadata={"Software": None})
    return len(all_curves)


def _mark(axis: Axes, episodes: Sequence[Curves], *, named: bool) -> None:
    """What befell the cloth, and who took the lead."""
    begun = {moment for curves in episodes for moment in curves.disturbances_s}
    held = {moment for curves in episodes for moment in curves.pulls_s}
    taken = {span for curves in episodes for span in curves.interventions_s}
    for moments, style, name in ((begun, "-", "disturbance"), (held, ":", "pulled by hand")):
        for number, moment_s in enumerate(sorted(moments)):
            axis.axvline(
                moment_s, color=MARK_COLOUR, linestyle=style, linewidth=1, alpha=_alpha(len(moments)), zorder=0,
                label=None if number else name,
            )  # fmt: skip
    for number, (first, end) in enumerate(sorted(taken)):
        axis.axvspan(
            first, end, color=PERSON_COLOUR, alpha=0.5 * _alpha(len(taken)), zorder=0, linewidth=0,
            label=None if number else "a person decides",
        )  # fmt: skip
    if named and (begun or held or taken):
        axis.legend(loc="lower right", fontsize=8)


def _alpha(count: int) -> float:
    return float(np.clip(CROWD / max(count, 1), 0.15, 0.9))


def _draw_paths(axis: Axes, episodes: Sequence[Curves]) -> None:
    """Of the hanger, or of both pickers, in the plane that the cloth is laid in."""
    for curves in episodes:
        tracks = [curves.holder_m] if curves.robot.n_points == 1 else [curves.corners_m[:, 0], curves.corners_m[:, 1]]
        for track, style in zip(tracks, LINE_STYLES, strict=False):
            colour = COLOURS[curves.outcome]
            axis.plot(track[:, 0], track[:, 2], style, color=colour, linewidth=THIN + 0.3, alpha=_alpha(len(episodes)))
            axis.plot(track[0, 0], track[0, 2], "o", color=colour, markersize=4)
            axis.plot(track[-1, 0], track[-1, 2], "s", color=colour, markersize=4)
    names = [outcome for outcome in OUTCOMES if any(curves.outcome == outcome for curves in episodes)]
    counts = {name: sum(curves.outcome == name for curves in episodes) for name in names}
    for name in names:
        axis.plot([], [], color=COLOURS[name], label=f"{name} ({counts[name]})")
    if any(curves.robot.n_points > 1 for curves in episodes):
        axis.plot([], [], "--", color=MUTED, label="picker 2")
    axis.plot([], [], "o", color=MUTED, markersize=4, label="start")
    axis.plot([], [], "s", color=MUTED, markersize=4, label="end")
    axis.legend(loc="upper right")
    axis.set_title("paths in the xz plane")
    axis.set_xlabel("x (m)")
    axis.set_ylabel("z (m)")
    axis.set_aspect("equal", adjustable="datalim")


def _draw_starts(axis: Axes, episodes: Sequence[Curves]) -> None:
    """Where the holder was at the first step; the cross is their mean with one standard deviation to each side."""
    starts = 1000 * np.array([curves.holder_m[0, [0, 2]] for curves in episodes])
    colours = [COLOURS[curves.outcome] for curves in episodes]
    axis.scatter(starts[:, 0], starts[:, 1], s=22, c=colours, linewidths=0, alpha=0.8)
    mean, spread = starts.mean(axis=0), starts.std(axis=0)
    axis.errorbar(mean[0], mean[1], xerr=spread[0], yerr=spread[1], color=MUTED, linewidth=1.2, capsize=3)
    axis.set_title(f"starts: {spread[0]:.0f} mm and {spread[1]:.0f} mm standard deviation")
    axis.set_xlabel("x (mm)")
    axis.set_ylabel("z (mm)")
    axis.margins(0.15)
    axis.locator_params(axis="x", nbins=5)


def _draw_actions(axis: Axes, episodes: Sequence[Curves]) -> None:
    """Every component of the displacement, each step; bold where it is the mean over the episodes."""
    for column, name in enumerate(episodes[0].robot.action_names):
        colour = AXIS_COLOURS[name[1]]
        style = LINE_STYLES[name.endswith("2")]
        tracks = [(curves.time_s[:-1], 1000 * curves.actions_m[:, column]) for curves in episodes]
        _draw_tracks(axis, tracks, colour, style, label=name)
    axis.set_title("actions")
    axis.set_ylabel("displacement (mm per step)")
    axis.legend(loc="best", ncols=2, frameon=True, facecolor="white", edgecolor="none", framealpha=0.8, fontsize=8)


def _draw_contact(axis: Axes, episodes: Sequence[Curves]) -> None:
    for outcome in OUTCOMES:
        tracks = [(curves.time_s, 100 * curves.contact) for curves in episodes if curves.outcome == outcome]
        if tracks:
            _draw_tracks(axis, tracks, COLOURS[outcome], "-", label=outcome)
    axis.set_ylim(0, 105)
    axis.set_title("contact portion, as the camera sees it")
    axis.set_ylabel("contact portion (%)")


def _draw_word(axis: Axes, episodes: Sequence[Curves]) -> None:
    """Dots, not lines: the direction may jump, and half of the time there is none."""
    for curves in episodes:
        axis.plot(
            curves.time_s, curves.word_deg, ".", color=COLOURS[curves.outcome], markersize=3,
            alpha=_alpha(len(episodes)), markeredgewidth=0,
        )  # fmt: skip
    axis.set_ylim(-95, 95)
    axis.set_yticks([-90, -45, 0, 45, 90])
    axis.set_title("WORD")
    axis.set_ylabel("direction (degrees from +x)")


def _draw_tracks(
    axis: Axes, tracks: Sequence[tuple[FloatArray, FloatArray]], colour: str, style: str, *, label: str
) -> None:
    """Each track thin; the mean over those that are still going on bold, where there are several."""
    for time_s, values in tracks:
        alone = len(tracks) == 1
        axis.plot(
            time_s, values, style, color=colour, linewidth=1.4 if alone else THIN,
            alpha=1.0 if alone else 0.6 * _alpha(len(tracks)), label=label if alone else None,
        )  # fmt: skip
    if len(tracks) > 1:
        step_s = float(np.median(np.diff(tracks[0][0]))) if len(tracks[0][0]) > 1 else 0.1
        first, last = min(time_s[0] for time_s, _ in tracks), max(time_s[-1] for time_s, _ in tracks)
        grid = np.arange(first, last + step_s / 2, step_s)
        known = np.array([np.interp(grid, *track, left=np.nan, right=np.nan) for track in tracks])
        there = np.isfinite(known).any(axis=0)
        axis.plot(grid[there], np.nanmean(known[:, there], axis=0), style, color=colour, linewidth=THICK, label=label)
