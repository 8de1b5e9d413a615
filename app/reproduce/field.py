"""Figure 4-1: the field that a model learned, its demonstrations and its variance."""

from __future__ import annotations

import numpy as np

from layflat.app.report.attractor_field import field_figure, vector_field
from layflat.app.reproduce.claims import NO, UNKNOWN, YES, Claim
from layflat.app.reproduce.experiment_output import ExperimentOutput
from layflat.app.reproduce.experiment_results import ExperimentResults
from layflat.app.reproduce.studies import placing
from layflat.policy.trained_model import RegressionModel


def render_field(results: ExperimentResults) -> ExperimentOutput:
    """Render the fields of the baseline and of the proposed method for each robot."""
    output = ExperimentOutput()
    for trial in placing(results.scale):
        specs = [spec for spec in trial.models if results.store.model_path(spec).exists()]
        trained = {spec.policy: results.store.model(spec) for spec in specs}
        models = {name: model for name, model in trained.items() if isinstance(model, RegressionModel)}
        episodes = results.store.demonstrations(trial.robot, trial.cloth, results.scale.demonstrations)
        if not models or not episodes:
            output.add_missing(trial.robot)
            continue
        output.blocks.append(field_figure(models, episodes))
        field = vector_field(next(iter(models.values())), episodes)
        length = np.hypot(field.dx, field.dz)
        near, far = (
            (1000 * float(length[part].mean()), 1000 * float(field.std[part].mean()))
            for part in (
                field.distance <= np.quantile(field.distance, 0.1),
                field.distance >= np.quantile(field.distance, 0.9),
            )
        )
        output.claims.append(
            Claim(
                what=f"the prediction fades, and its variance grows, away from the demonstrations ({trial.robot})",
                source="chapters 4-2-2, 4-2-3, Figure 4-1",
                thesis="yes",
                ours=f"{near[0]:.1f} mm a step near (std {near[1]:.1f} mm), {far[0]:.1f} mm far away "
                f"(std {far[1]:.1f} mm)",
                agrees=YES if far[0] < near[0] and far[1] > near[1] else NO,
            )
        )
    if not output.claims:
        output.claims.append(Claim(what="the field", source="Figure 4-1", thesis="", ours=UNKNOWN, agrees=UNKNOWN))
    return output
