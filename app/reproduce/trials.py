"""Trials as batches: from what is wanted to what is run, and back from the folder."""

from __future__ import annotations

from pathlib import Path

from layflat.app.evaluation.plan import DisturbanceCase, EvaluationPlan, PolicySpec
from layflat.app.evaluation.results import EvaluationResults
from layflat.app.evaluation.run import run_batch
from layflat.app.reproduce.artifact_store import ArtifactStore
from layflat.app.reproduce.studies import FIRST_SEED, Trial
from layflat.app.support.progress import Progress
from layflat.app.workers.schedule import ScheduledDisturbance
from layflat.data.errors import DataError
from layflat.sim.cloth.starts import STARTS
from layflat.sim.disturbances.presets import DISTURBANCES

CORE_S = {"crumpled": 6.0}
USUAL_CORE_S = 7.0
"""Of one placing, for the first estimate of the time left."""
REPEAT_CORE_S = 3.0
"""Of one disturbance and its repair."""


def trial_folder(out: Path, trial: Trial) -> Path:
    return out / "trials" / trial.name


def trial_seconds(trial: Trial) -> float:
    """Core-seconds, about."""
    each = CORE_S.get(trial.start, USUAL_CORE_S) + REPEAT_CORE_S * sum(repeats for _, repeats in trial.disturbances)
    return each * trial.seeds * len(trial.players)


def plan_of(trial: Trial, workshop: ArtifactStore, seed: int) -> EvaluationPlan:
    """The batch of a trial whose models are there; seeds begin at FIRST_SEED + ``seed``."""
    entrants = [
        PolicySpec(
            name=player.name,
            robot=trial.robot,
            model=None if player.taught is None else workshop.model(player.taught),
            made=player.made,
            controller=player.controller,
        )
        for player in trial.players
    ]
    first = FIRST_SEED + seed
    cases = [
        DisturbanceCase(name=name, schedule=(ScheduledDisturbance(spec=DISTURBANCES[name], repeats=repeats),))
        for name, repeats in trial.disturbances
    ]
    return EvaluationPlan(
        entrants=tuple(entrants),
        cloths=(trial.cloth,),
        seeds=tuple(range(first, first + trial.seeds)),
        cases=tuple(cases),
        start=next(start for start in STARTS if start == trial.start),
    )


def run_trial(trial: Trial, out: Path, workshop: ArtifactStore, seed: int, progress: Progress, *, workers: int) -> None:
    """Run what the folder does not hold yet; ``progress`` is in a phase of ``trial.episodes`` items."""
    run_batch(plan_of(trial, workshop, seed), trial_folder(out, trial), workers=workers, progress=progress)


def results_of(trial: Trial, out: Path) -> EvaluationResults | None:
    """What the folder holds of a trial; None where it was not begun."""
    try:
        results = EvaluationResults.open(trial_folder(out, trial))
    except DataError:
        return None
    return results if len(results.rows) else None
