"""The field that a model has learned (thesis, Figure 4-1): predicted displacement in the xz plane."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from scipy.special import softmax

from layflat.app.media.plot_style import ALERT, INK, SERIES, styled_figure, svg_text
from layflat.app.report.blocks import Figure
from layflat.app.report.charts import PANEL_IN, key
from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec
from layflat.data.types import Episode
from layflat.policy.features import WORLD, FeatureLayout
from layflat.policy.training_set import recorded_size

BANDWIDTH_M = 0.02
"""Width of the Gaussian that averages the other inputs over the demonstrations' steps near a point of the plane."""
MARGIN_M = 0.06
CONTACT = "contact"
"""Name of the contact portion among a model's inputs."""
GRID = (27, 17)
DEMONSTRATION_COLOR = SERIES[3]
SHADES, SHADE = 6, 0.045
"""Steps of the standard deviation, and how much ink each lays over those below."""


class VectorFieldModel(Protocol):
    """Model that predicts displacements."""

    @property
    def layout(self) -> FeatureLayout:
        """Names of the inputs."""

    def predict(self, inputs: FloatArray, /) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation (N, A) m for inputs (N, D)."""


@dataclass(frozen=True, kw_only=True)
class VectorField:
    """A model's prediction on a grid of the xz plane; arrays (rows, columns), in metres."""

    x: FloatArray
    z: FloatArray
    dx: FloatArray
    dz: FloatArray
    std: FloatArray
    """Root mean square of both outputs' standard deviations."""
    distance: FloatArray
    """To the nearest step of a demonstration."""


def plane_of(robot: RobotSpec) -> tuple[str, str, int, int]:
    """Return the x and z columns of the robot's first point, and the components of the action that move them."""
    x, z = (next(k for k, own in enumerate(robot.axes) if (own.point, own.axis) == (0, axis)) for axis in (0, 2))
    return robot.coordinates[x], robot.coordinates[z], x, z


def vector_field(
    model: VectorFieldModel, demonstrations: Sequence[Episode], *, contact: float | None = None
) -> VectorField:
    """Evaluate a model around its demonstrations in the plane of the robot's first point.

    Inputs outside the plane are, at each point, the average over the demonstrations' steps near it; ``contact``, if
    given, is the contact portion everywhere.
    """
    layout = model.layout
    column_x, column_z, out_x, out_z = plane_of(layout.robot)
    known = np.concatenate([layout.matrix(episode.steps) for episode in demonstrations])
    plane = [layout.names.index(column_x), layout.names.index(column_z)]
    low, high = known[:, plane].min(axis=0) - MARGIN_M, known[:, plane].max(axis=0) + MARGIN_M
    x, z = np.meshgrid(np.linspace(low[0], high[0], GRID[0]), np.linspace(max(low[1], 0.0), high[1], GRID[1]))
    points = np.column_stack([x.ravel(), z.ravel()])
    squared = ((points[:, None, :] - known[None, :, plane]) ** 2).sum(axis=2)
    inputs = softmax(-0.5 * squared / BANDWIDTH_M**2, axis=1) @ known
    inputs[:, plane] = points
    if contact is not None:
        inputs[:, layout.names.index(CONTACT)] = contact
    mean, std = model.predict(inputs)
    both = np.sqrt((std[:, [out_x, out_z]] ** 2).mean(axis=1))
    columns = (mean[:, out_x], mean[:, out_z], both, np.sqrt(squared.min(axis=1)))
    dx, dz, std, distance = (column.reshape(x.shape) for column in columns)
    return VectorField(x=x, z=z, dx=dx, dz=dz, std=std, distance=distance)


def _in_frame(layout: FeatureLayout, episode: Episode) -> Episode:
    """Return a demonstration in the coordinates of a model."""
    size = recorded_size(episode.cloth, episode.sim_config)
    if layout.frame == WORLD or size is None or size.is_world:
        return episode
    steps = tuple(replace(step, observation=size.observation(step.observation)) for step in episode.steps)
    return replace(episode, steps=steps, final_observation=size.observation(episode.final_observation))


def field_figure(
    models: Mapping[str, VectorFieldModel], demonstrations: Sequence[Episode], *, contact: float | None = None
) -> Figure:
    """Draw the field of each model by its name: arrows over the standard deviation, with the demonstrations.

    ``contact``: portion at which the contact is held in one more panel of each model that sees it, or None.
    """
    layout = next(iter(models.values())).layout
    robot, demonstrations = layout.robot, [_in_frame(layout, episode) for episode in demonstrations]
    fields: dict[str, VectorField] = {}
    for name, model in models.items():
        fields[name] = vector_field(model, demonstrations)
        if contact is not None and CONTACT in model.layout.names:
            title = f"{name}, contact held at {100 * contact:.0f} %"
            fields[title] = vector_field(model, demonstrations, contact=contact)
    max_std_mm = max(1000 * float(field.std.max()) for field in fields.values())
    longest_m = max(float(np.hypot(field.dx, field.dz).max()) for field in fields.values())
    panels = tuple(
        _panel(name, field, robot, demonstrations, max_std_mm=max_std_mm, longest_m=longest_m)
        for name, field in fields.items()
    )
    legend = (
        key(f"{len(demonstrations)} demonstrations", color=DEMONSTRATION_COLOR, marker="o"),
        key("end", color=ALERT, marker="s", linestyle="none"),
        key(f"standard deviation, up to {max_std_mm:.1f} mm a step", color=INK, alpha=SHADES * SHADE, linewidth=9),
    )
    part = "the holder" if robot.n_points == 1 else "the first held corner"
    caption = (
        f"{robot} robot: the displacement that a model predicts for {part} in the xz plane (arrows, length "
        "proportional) over its standard deviation (shaded: unsure), with the "
        f"{len(demonstrations)} demonstrations it learned from. Inputs outside the plane are, at each point, those of "
        "the demonstrations' steps near it."
    )
    if contact is not None and len(fields) > len(models):
        caption += f" Where the contact is held, the cloth counts as {100 * contact:.0f} % flat everywhere."
    alt = f"Learned displacements of the {robot} robot in the xz plane: {', '.join(fields)}."
    return Figure(panels=panels, alt=alt, caption=caption, legend=legend)


def _panel(
    title: str,
    field: VectorField,
    robot: RobotSpec,
    demonstrations: Sequence[Episode],
    *,
    max_std_mm: float,
    longest_m: float,
) -> str:
    with styled_figure(*PANEL_IN) as drawing:
        axis = drawing.subplots()
        for low in np.linspace(0, max_std_mm, SHADES, endpoint=False)[1:]:
            # One over the other: shades side by side would leave seams.
            levels, color = [float(low), 1.01 * max_std_mm + 1e-9], to_rgba(INK, SHADE)
            axis.contourf(field.x, field.z, 1000 * field.std, levels=levels, colors=[color], zorder=0)
        axis.quiver(
            field.x, field.z, field.dx, field.dz, angles="xy", scale_units="xy", scale=(longest_m or 0.035) / 0.035,
            color=INK, width=0.004, zorder=3, headwidth=3.6, headlength=4, minlength=0.3,
        )  # fmt: skip
        _draw_demonstrations(axis, robot, demonstrations)
        axis.set(title=title, xlabel="x (m)", ylabel="z (m)", aspect="equal")
        return svg_text(drawing)


def _draw_demonstrations(axis: Axes, robot: RobotSpec, demonstrations: Sequence[Episode]) -> None:
    layout = FeatureLayout(robot=robot, names=plane_of(robot)[:2])
    for episode in demonstrations:
        path = np.array([layout.vector(observation) for observation in episode.observations()])
        axis.plot(*path.T, color=DEMONSTRATION_COLOR, linewidth=1.3, alpha=0.9, zorder=2)
        axis.plot(*path[0], "o", color=DEMONSTRATION_COLOR, markersize=3.5, zorder=4)
        axis.plot(*path[-1], "s", color=ALERT, markersize=3.5, zorder=4)
