"""Trials as evaluations: from the plan of a reproduction to its results in the folder."""

from __future__ import annotations

from pathlib import Path

from layflat.app.evaluation.plan import EvaluationPlan
from layflat.app.evaluation.results import EvaluationResults
from layflat.app.evaluation.run import run_evaluation
from layflat.app.reproduce.artifact_store import ArtifactStore
from layflat.app.reproduce.studies import FIRST_SEED, Trial
from layflat.app.support.progress import Progress
from layflat.app.workers.work_item import DisturbanceCase
from layflat.data.errors import DataError
from layflat.policy.schedule import ScheduledDisturbance
from layflat.policy.spec import SMOOTH, PolicySpec
from layflat.sim.disturbances.presets import DISTURBANCES

PLACING_S = 7.0
CRUMPLED_S = 6.0
DISTURBANCE_S = 3.0
"""Core-seconds of a placing, of a wrinkle removal, and of a disturbance with its repair, for the first estimate."""


def trial_folder(out: Path, trial: Trial) -> Path:
    """Return the folder of a trial's evaluation."""
    return out / "trials" / trial.name


def expected_core_s(trial: Trial) -> float:
    """Return the expected core-seconds of a trial."""
    placing_s = CRUMPLED_S if trial.task == SMOOTH else PLACING_S
    episode_s = placing_s + DISTURBANCE_S * sum(repeats for _, repeats in trial.disturbances)
    return episode_s * trial.seeds * len(trial.policies)


def plan_of(trial: Trial, store: ArtifactStore, seed: int) -> EvaluationPlan:
    """Return the evaluation of a trial whose models exist; its seeds begin at FIRST_SEED + ``seed``."""
    policies = tuple(
        PolicySpec(
            label=policy.name,
            model=None if policy.model is None else store.model(policy.model),
            builtin=policy.builtin,
        )
        for policy in trial.policies
    )
    cases = tuple(
        DisturbanceCase(name=name, schedule=(ScheduledDisturbance(disturbance=DISTURBANCES[name], repeats=repeats),))
        for name, repeats in trial.disturbances
    )
    first = FIRST_SEED + seed
    return EvaluationPlan(
        policies=policies,
        robots=(trial.robot,),
        task=trial.task,
        cloths=(trial.cloth,),
        seeds=tuple(range(first, first + trial.seeds)),
        cases=cases,
        start=trial.start,
    )


def run_trial(trial: Trial, out: Path, store: ArtifactStore, seed: int, progress: Progress, *, workers: int) -> None:
    """Run the missing episodes; ``progress`` is in a phase of ``trial.episodes`` items."""
    run_evaluation(plan_of(trial, store, seed), trial_folder(out, trial), workers=workers, progress=progress)


def results_of(trial: Trial, out: Path) -> EvaluationResults | None:
    """Return the results of a trial; None where it was not begun."""
    try:
        results = EvaluationResults.open(trial_folder(out, trial))
    except DataError:
        return None
    return results if len(results.rows) else None
