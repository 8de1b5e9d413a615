"""`layflat train`: train a policy from demonstrations."""

from __future__ import annotations

import sys
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from layflat.app.support import validators
from layflat.app.support.console import print_table
from layflat.app.support.errors import UsageError, say
from layflat.app.support.progress import Progress
from layflat.app.support.session_lines import copies_text, pairs_text
from layflat.data.provenance import capture_provenance
from layflat.data.session.reader import open_session
from layflat.policy import model_io, registry
from layflat.policy.gp.model import GpModel
from layflat.policy.trained_model import TrainedModel
from layflat.policy.training_set import Demonstrations

EXPECTED_S = 30.0


@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """Settings of one `layflat train` call."""

    data: Path
    model: Path
    policy: str = registry.TRAINABLE_POLICIES[0]
    seed: int = 0
    intervention_weight: int = 1


def train(config: TrainConfig, *, force: bool) -> TrainedModel:
    """Train a policy from the successful demonstrations of a session, save the model and print its numbers."""
    validators.one_of("policy", config.policy, registry.TRAINABLE_POLICIES)
    validators.writable_file(config.model, suffix=".npz", force=force)
    demonstrations = successful_demonstrations(config.data)
    corrected, weight = int(demonstrations.interventions.sum()), config.intervention_weight
    if weight != 1 and not corrected:
        raise UsageError(f"{config.data} has no intervention steps; remove --intervention-weight")
    # GPy prints when it is interrupted; stdout is for results.
    with Progress({"training": EXPECTED_S}) as progress, redirect_stdout(sys.stderr):
        progress.phase("training")
        model = registry.train(
            config.policy,
            demonstrations,
            seed=config.seed,
            provenance=capture_provenance(),
            progress=lambda done, of, clause: progress.within(done / of, clause),
            intervention_weight=weight,
        )
    model_io.save(model, config.model, force=force)
    print_results(model)
    print(f"wrote {config.model}")
    if corrected:
        times = "once" if weight == 1 else f"{weight} times"
        print(f"{corrected} steps in which a person corrected a policy count {times} each")
    return model


def successful_demonstrations(path: Path) -> Demonstrations:
    """Read the steps of a session's successful episodes; UsageError where there is none."""
    with open_session(path) as session:
        names = session.select(outcome="success")
        if not len(session):
            raise UsageError(f"{path} holds no demonstrations; record some with `layflat record {path}`")
        if not names:
            raise UsageError(f"none of the {len(session)} demonstrations in {path} succeeded; record more")
        copies, found = session.copies(names), Demonstrations.from_session(session, names)
    if copies:
        say(f"{path}: {copies_text(copies)}; each counts once")
    single = [name for name in names if name not in copies]
    related = {single[k]: single[first] for k, first in enumerate(found.recordings) if first != k}
    if related:
        say(f"{path}: {pairs_text(related, 'shares steps with')}; these steps count once, and are held out together")
    return found


def print_results(model: TrainedModel) -> None:
    """Print points, hyperparameters and held-out error."""
    columns = hyperparameters(model) if isinstance(model, GpModel) else {}
    rows = [
        [
            name,
            *(values[a] for values in columns.values()),
            "needs 2 demonstrations" if model.heldout_rmse_m is None else f"{1000 * model.heldout_rmse_m[a]:.2f}",
        ]
        for a, name in enumerate(model.outputs)
    ]
    title = f"{model.policy}, {model.layout.robot} robot, {model.cloth}"
    print_table(("output", *columns, "held-out error (mm)"), rows, title=title, left=1)
    kernel = f"kernel {model.hyper.kernel}; " if isinstance(model, GpModel) else ""
    print(
        f"{model.n_points} {model.point_name} of {model.points_available} steps in {model.demonstrations} "
        f"demonstrations; inputs {', '.join(model.layout.names)}; {kernel}seed {model.seed}"
    )


def hyperparameters(model: GpModel) -> dict[str, list[str]]:
    """Return columns of the table, a cell for each output."""
    to_mm, hyper = 1000 * model.output_scale_m, model.hyper
    return {
        "length scale": [length_scales(model, a) for a in range(len(model.outputs))],
        "signal std (mm)": [f"{to_mm * np.sqrt(variance):.2f}" for variance in hyper.variance],
        "noise std (mm)": [f"{to_mm * np.sqrt(noise):.2f}" for noise in hyper.noise],
    }


def length_scales(model: GpModel, output: int) -> str:
    """Return the length scales of one output, in units of the inputs' scales: one number where all are equal."""
    scales = model.hyper.length_scales[output]
    return f"{scales[0]:.2f}" if np.ptp(scales) == 0 else " ".join(f"{scale:.2f}" for scale in scales)
