"""Figure 4-1: the field that a model learned, its demonstrations and its variance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from layflat.app.report import figures
from layflat.app.report.blocks import Block, Figure, Text
from layflat.app.reproduce.experiment_results import MISSING, Claim, ExperimentOutput, ExperimentResults
from layflat.app.reproduce.studies import placing
from layflat.app.reproduce.table_cells import NO, UNKNOWN, YES
from layflat.data.types import Episode
from layflat.policy.trained_model import RegressionModel
from layflat.sim.robots.registry import robot_spec


def show(material: ExperimentResults) -> ExperimentOutput:
    """For each robot the fields of the baseline and of the proposed method in the xz plane."""
    blocks: list[Block] = []
    claims = []
    for trial in placing(material.size):
        there = [t for t in trial.taught if material.workshop.model_path(t).exists()]
        models = {t.policy: model for t in there if isinstance(model := material.workshop.model(t), RegressionModel)}
        learned = material.workshop.demonstrations(trial.robot, trial.cloth, material.size.demonstrations)
        if not models or not learned:
            blocks.append(Text(lines=(f"{trial.robot}: {MISSING}",)))
            continue
        panels = [figures.SubplotSpec(model=model, title=name, held={}) for name, model in models.items()]
        png = figures.attractor_field(robot_spec(trial.robot), panels, learned)
        who = "picker 1" if trial.robot == "pickers" else "the hanger"
        caption = (
            f"{trial.robot} robot: the displacement that a model predicts for {who} in the xz plane (arrows, length "
            "proportional) over its standard "
            f"deviation (grey: unsure), with the {len(learned)} demonstrations it learned from. Inputs outside the "
            "plane are, at each point, those of "
            f"the demonstrations' steps near it."
        )
        blocks.append(Figure(png=png, alt=f"attractor field, {trial.robot}", caption=caption))
        near, far, sure, unsure = _near_and_far(trial.robot, panels[0], learned)
        claims.append(
            Claim(
                what=f"the prediction fades, and its variance grows, away from the demonstrations ({trial.robot})",
                source="chapters 4-2-2, 4-2-3, Figure 4-1",
                thesis="yes",
                ours=f"{1000 * near:.1f} mm a step near (std {1000 * sure:.1f} mm), {1000 * far:.1f} mm far away "
                f"(std {1000 * unsure:.1f} mm)",
                holds=YES if far < near and unsure > sure else NO,
            )
        )
    if not claims:
        claims.append(Claim(what="the field", source="Figure 4-1", thesis="", ours=UNKNOWN, holds=UNKNOWN))
    return ExperimentOutput(blocks=tuple(blocks), claims=tuple(claims))


def _near_and_far(
    robot: str, panel: figures.SubplotSpec, learned: Sequence[Episode]
) -> tuple[float, float, float, float]:
    """Mean length (m) of the prediction on the tenth of the grid nearest to the demonstrations and on the farthest,
    and the standard deviations (m) there."""
    x, z, dx, dz, std = figures.field_of(robot_spec(robot), panel, learned)
    column_x, column_z, _, _ = figures.plane_of(robot_spec(robot))
    layout = panel.model.layout
    known = np.concatenate([layout.matrix(episode.steps) for episode in learned])
    places = known[:, [layout.names.index(column_x), layout.names.index(column_z)]]
    grid = np.column_stack([x.ravel(), z.ravel()])
    distance = np.sqrt(((grid[:, None] - places[None]) ** 2).sum(axis=2).min(axis=1))
    length = np.hypot(dx, dz).ravel()
    near, far = distance <= np.quantile(distance, 0.1), distance >= np.quantile(distance, 0.9)
    flat = std.ravel()
    return float(length[near].mean()), float(length[far].mean()), float(flat[near].mean()), float(flat[far].mean())
