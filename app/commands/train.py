"""`layflat train`: train a policy from demonstrations."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import numpy as np

from layflat.app.support import validators
from layflat.app.support.console import print_table
from layflat.app.support.errors import UsageError, say
from layflat.app.support.progress import Progress
from layflat.app.support.session_lines import copies_text, pairs_text
from layflat.data.cloth_frame import ClothFrame
from layflat.data.provenance import capture_provenance
from layflat.data.session.reader import open_session
from layflat.policy import model_io, registry
from layflat.policy.features import Frame
from layflat.policy.gp.model import GpModel
from layflat.policy.trained_model import TrainedModel
from layflat.policy.training_set import Demonstrations, recorded_size
from layflat.sim.config import recorded_spec
from layflat.sim.errors import SimError

EXPECTED_S = 30.0


@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """Settings of one `layflat train` call."""

    data: Path
    model: Path
    policy: str = registry.TRAINABLE_POLICIES[0]
    seed: int = 0
    intervention_weight: int = 1
    also: tuple[Path, ...] = ()
    """Further sessions, of the same robot and task."""
    frame: Frame | None = None
    """Coordinates of the model; None: the cloth's where every cloth's size is known."""


def train(config: TrainConfig, *, force: bool) -> TrainedModel:
    """Train a policy from the successful demonstrations of a session, save the model and print its numbers."""
    validators.one_of("policy", config.policy, registry.TRAINABLE_POLICIES)
    validators.writable_file(config.model, suffix=".npz", force=force)
    if config.frame is not None:
        validators.one_of("frame", config.frame, get_args(Frame))
    demonstrations = Demonstrations.joined([successful_demonstrations(path) for path in (config.data, *config.also)])
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
            frame=config.frame,
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
        copies, found = session.copies(names), Demonstrations.from_session(session, names, cloth_size)
    if copies:
        say(f"{path}: {copies_text(copies)}; each counts once")
    single = [name for name in names if name not in copies]
    related = {single[k]: single[first] for k, first in enumerate(found.recordings) if first != k}
    if related:
        say(f"{path}: {pairs_text(related, 'shares steps with')}; these steps count once, and are held out together")
    return found


def cloth_size(cloth: str, settings: Mapping[str, object]) -> ClothFrame | None:
    """Return the size of a recorded cloth: as recorded, or that of the preset of its name."""
    try:
        spec = recorded_spec(cloth, settings)
    except SimError:
        return recorded_size(cloth, settings)
    return ClothFrame(length_m=spec.length_m, width_m=spec.width_m)


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
    names = ", ".join(cloth.name for cloth in model.cloths) or model.cloth
    title = f"{model.policy}, {model.layout.robot} robot, {names}"
    print_table(("output", *columns, "held-out error (mm)"), rows, title=title, left=1)
    kernel = f"kernel {model.hyper.kernel}; " if isinstance(model, GpModel) else ""
    print(
        f"{model.n_points} {model.point_name} of {model.points_available} steps in {model.demonstrations} "
        f"demonstrations; inputs {', '.join(model.layout.names)}, {model.layout.frame} frame; {kernel}seed {model.seed}"
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
