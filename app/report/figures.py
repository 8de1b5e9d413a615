"""The report's two figures, as PNG bytes: contact portion over time, and the attractor field (thesis, Figure 4-1)."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.special import softmax

from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec
from layflat.data.types import Episode
from layflat.policy.features import FeatureLayout

matplotlib.use("Agg")

POLICY_COLOURS: Mapping[str, str] = {
    "gp-baseline": "#c2571a",
    "gp-word": "#0f766e",
    "gp-contact": "#6d5bd0",
    "gp-direction": "#b8336a",
    "gp-baseline+drag-rule": "#4d7c0f",
    "gp-finish+recovery+steady": "#1d4ed8",
    "word": "#0f766e",
    "stretch-right": "#c2571a",
    "random": "#667382",
}
OTHER_COLOURS = ("#0369a1", "#a16207", "#475569", "#9f1239")
INK = "#1d2733"
MUTED = "#667382"
STYLE: Any = {
    "font.size": 9,
    "font.family": "DejaVu Sans",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#b6c0cb",
    "axes.labelcolor": INK,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titlecolor": INK,
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "grid.color": "#e8ecf0",
    "legend.frameon": False,
}
DPI = 160
ZOOM_BEFORE_S = 3.0

BANDWIDTH_M = 0.02
"""Width of the Gaussian that averages the other inputs over the demonstrations' steps near a point of the plane."""
MARGIN_M = 0.06
GRID = (27, 17)

"""Input columns of the plane that is drawn, and the outputs along them."""


class VectorFieldModel(Protocol):
    """What the attractor field needs of a model."""

    @property
    def layout(self) -> FeatureLayout: ...

    def predict(self, inputs: Any, /) -> tuple[FloatArray, FloatArray]: ...


def colour_of(policy: str, number: int = 0) -> str:
    """The policy's colour everywhere in the report; ``number`` tells those without one of their own apart."""
    return POLICY_COLOURS.get(policy, OTHER_COLOURS[number % len(OTHER_COLOURS)])


# Contact portion over time


def contact_over_time(runs: Mapping[str, Sequence[Episode]]) -> bytes:
    """Camera contact portion of every run (thin) and its mean over the seeds (bold), by policy.

    Time 0 is the beginning of the disturbance, or of the episode where there is none. Left the whole episode, right
    from shortly before the disturbance. A run that has ended keeps its last value in the mean: its cloth lies still.
    """
    disturbed = any(run.phase_bounds("disturb") for group in runs.values() for run in group)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(10.4, 3.3), layout="constrained")
        axes = list(figure.subplots(1, 2 if disturbed else 1, squeeze=False)[0])
        for number, (policy, group) in enumerate(runs.items()):
            for axis in axes:
                _draw_runs(axis, group, colour_of(policy, number), policy)
        axes[0].set_title("whole episode")
        axes[0].set_ylim(0, 105)
        axes[0].legend(loc="upper left")
        if disturbed:
            _mark_disturbance(axes, [run for group in runs.values() for run in group])
            _zoom(axes[1], [run for group in runs.values() for run in group])
        for axis in axes:
            axis.set_xlabel("time since the disturbance began (s)" if disturbed else "time (s)")
            axis.set_ylabel("contact portion (%)")
            axis.grid(axis="y")
        return _png(figure)


def times(episode: Episode) -> FloatArray:
    """(len(steps) + 1,) s, 0 at the beginning of the disturbance where there is one."""
    bounds = episode.phase_bounds("disturb")
    steps = np.arange(len(episode.steps) + 1, dtype=np.float64)
    return (steps - (bounds[0] if bounds else 0)) * episode.step_s


def mean_curve(group: Sequence[Episode]) -> tuple[FloatArray, FloatArray]:
    """Times and mean contact portion, from when half of the runs have begun; later they keep their last value."""
    step_s = group[0].step_s
    starts = [times(run)[0] for run in group]
    grid = np.arange(np.median(starts), max(times(run)[-1] for run in group) + step_s / 2, step_s)
    curves = [np.interp(grid, times(run), run.contact(), left=np.nan) for run in group]
    return grid, np.nanmean(curves, axis=0)


def _draw_runs(axis: Axes, group: Sequence[Episode], colour: str, label: str) -> None:
    for run in group:
        axis.plot(times(run), 100 * run.contact(), color=colour, alpha=0.3, linewidth=0.8)
    if group:
        grid, mean = mean_curve(group)
        axis.plot(grid, 100 * mean, color=colour, linewidth=2.4, label=f"{label} (mean of {len(group)})")


def _mark_disturbance(axes: Sequence[Axes], runs: Sequence[Episode]) -> None:
    spans = [(run.phase_bounds("disturb"), run.step_s) for run in runs]
    length_s = float(np.mean([(bounds[1] - bounds[0]) * step_s for bounds, step_s in spans if bounds]))
    for axis in axes:
        axis.axvspan(0, length_s, color="#f3d9d6", linewidth=0, zorder=0)
        axis.axvline(0, color="#b3372b", linewidth=1)
        axis.annotate(
            "disturbance", (0, 0.03), xycoords=("data", "axes fraction"), xytext=(-4, 0),
            textcoords="offset points", ha="right", color="#b3372b", fontsize=8,
        )  # fmt: skip


def _zoom(axis: Axes, runs: Sequence[Episode]) -> None:
    """From shortly before the disturbance to the end, on the range of values that occur there."""
    axis.set_title("disturbance and repair")
    late = [100 * run.contact()[times(run) >= 0] for run in runs if run.phase_bounds("disturb")]
    axis.set_ylim(max(0.0, min(values.min() for values in late) - 4), 103)
    axis.set_xlim(-ZOOM_BEFORE_S, max(times(run)[-1] for run in runs))


# Attractor field


@dataclass(frozen=True, kw_only=True)
class SubplotSpec:
    """One attractor field: a model, its title, and inputs that are held at a value."""

    model: VectorFieldModel
    title: str
    held: Mapping[str, float]


def attractor_field(robot: RobotSpec, panels: Sequence[SubplotSpec], demonstrations: Sequence[Episode]) -> bytes:
    """Mean displacement (arrows) over its standard deviation (shade) in the xz plane, with the demonstrations.

    Thesis, Figure 4-1; in the pickers robot of picker 1. The inputs that are not in the plane are, at each point, the
    average over the demonstrations' steps near it, unless a panel holds them.
    """
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(10.4, 3.5 if len(panels) > 1 else 4.2), layout="constrained")
        axes = list(figure.subplots(1, len(panels), squeeze=False, sharey=True)[0])
        fields = [field_of(robot, panel, demonstrations) for panel in panels]
        top_mm = max(1000 * float(std.max()) for *_, std in fields)
        longest_m = max(float(np.hypot(dx, dz).max()) for _, _, dx, dz, _ in fields)
        shade = None
        for axis, panel, (x, z, dx, dz, std) in zip(axes, panels, fields, strict=True):
            shade = axis.contourf(
                x, z, 1000 * std, levels=np.linspace(0, top_mm, 13), cmap=_shades(), zorder=0, antialiased=True
            )
            scale = longest_m / 0.035 if longest_m > 0 else 1.0
            axis.quiver(
                x, z, dx, dz, angles="xy", scale_units="xy", scale=scale, color=INK, width=0.0028, zorder=3,
                headwidth=3.6, headlength=4, minlength=0.3,
            )  # fmt: skip
            _draw_demonstrations(axis, robot, demonstrations)
            axis.set_title(panel.title)
            axis.set_xlabel("x (m)")
            axis.set_aspect("equal")
        axes[0].set_ylabel("z (m)")
        axes[0].legend(
            loc="upper right", fontsize=7.5, frameon=True, facecolor="white", edgecolor="none", framealpha=0.85
        )
        if shade is not None:
            figure.colorbar(
                shade, ax=axes, shrink=0.75, pad=0.01, label="standard deviation (mm per step)", format="%.1f"
            )
        return _png(figure)


def field_of(
    robot: RobotSpec, panel: SubplotSpec, demonstrations: Sequence[Episode]
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """x, z, dx, dz (m) and standard deviation (m, root mean square of both outputs), each (rows, columns)."""
    column_x, column_z, out_x, out_z = plane_of(robot)
    layout = panel.model.layout
    known = np.concatenate([layout.matrix(episode.steps) for episode in demonstrations])
    plane = [layout.names.index(column_x), layout.names.index(column_z)]
    low, high = known[:, plane].min(axis=0) - MARGIN_M, known[:, plane].max(axis=0) + MARGIN_M
    x, z = np.meshgrid(np.linspace(low[0], high[0], GRID[0]), np.linspace(max(low[1], 0.0), high[1], GRID[1]))
    points = np.column_stack([x.ravel(), z.ravel()])
    inputs = nearby_average(known, known[:, plane], points)
    inputs[:, plane] = points
    for name, value in panel.held.items():
        inputs[:, layout.names.index(name)] = value
    mean, std = panel.model.predict(inputs)
    both = np.sqrt((std[:, [out_x, out_z]] ** 2).mean(axis=1))
    return x, z, mean[:, out_x].reshape(x.shape), mean[:, out_z].reshape(x.shape), both.reshape(x.shape)


def nearby_average(values: FloatArray, places: FloatArray, points: FloatArray) -> FloatArray:
    """(M, D) average of values (N, D) known at places (N, 2), Gaussian weights around points (M, 2)."""
    squared = ((points[:, None, :] - places[None, :, :]) ** 2).sum(axis=2)
    return np.asarray(softmax(-0.5 * squared / BANDWIDTH_M**2, axis=1) @ values)


def _draw_demonstrations(axis: Axes, robot: RobotSpec, demonstrations: Sequence[Episode]) -> None:
    column_x, column_z, _, _ = plane_of(robot)
    layout = FeatureLayout(robot=robot, names=(column_x, column_z))
    for number, episode in enumerate(demonstrations):
        path = np.array([layout.vector(observation) for observation in episode.observations()])
        label = f"{len(demonstrations)} demonstrations" if number == 0 else None
        axis.plot(path[:, 0], path[:, 1], color="#3b82c4", linewidth=1.3, alpha=0.9, zorder=2, label=label)
        axis.plot(*path[0], "o", color="#3b82c4", markersize=3.5, zorder=4)
        axis.plot(*path[-1], "s", color="#b3372b", markersize=3.5, zorder=4, label="end" if number == 0 else None)


def _shades() -> Any:
    """White where the model is sure, grey where it is not."""
    return matplotlib.colors.LinearSegmentedColormap.from_list("sure", ["#ffffff", "#dfe5ea", "#b9c3cd"])


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    return buffer.getvalue()


def plane_of(robot: RobotSpec) -> tuple[str, str, int, int]:
    """Return the x and z columns of the robot's first point, and the components of the action that move them."""
    x, z = (next(k for k, axis in enumerate(robot.axes) if (axis.point, axis.axis) == (0, way)) for way in (0, 2))
    return robot.coordinates[x], robot.coordinates[z], x, z
