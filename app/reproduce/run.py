"""Runs what a reproduction needs, in the order of importance, and writes its page."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from layflat.app.reproduce.artifact_store import ArtifactStore
from layflat.app.reproduce.experiment_results import ExperimentResults
from layflat.app.reproduce.experiments import EXPERIMENTS, Experiment
from layflat.app.reproduce.report import write_reports
from layflat.app.reproduce.studies import FULL, QUICK, ScaleConfig, Trial
from layflat.app.reproduce.trials import run_trial, trial_seconds
from layflat.app.support import validators
from layflat.app.support.errors import UsageError
from layflat.app.support.metrics import write_json
from layflat.app.support.progress import Progress
from layflat.sim.cloth.starts import STARTS

ASKED = "reproduction.json"
MODEL_S = 40.0
"""Core-seconds of a model and its share of the demonstrations, for the first estimate of the time left."""
REPORT_S = 60.0


def reproduce(
    out: Path,
    *,
    quick: bool,
    seeds: int | None,
    seed: int,
    only: Sequence[str],
    workers: int,
    report_only: bool,
) -> Path:
    """Run what DIR does not hold yet, and write DIR/report.html and DIR/table.md; returns the page's path."""
    wanted = chosen(only)
    size = size_of(quick, seeds)
    validators.writable_folder(out)
    _check_asked(out, size, seed)
    workshop = ArtifactStore(out, seed=seed)
    trials = trials_of(wanted, size)
    with Progress(_phases(trials, workers, report_only)) as progress:
        if not report_only:
            for trial in trials:
                progress.phase(f"{trial.name}: models", items=len(trial.players))
                workshop.prepare(trial.taught, progress, workers=workers)
                progress.phase(trial.name, items=trial.episodes)
                run_trial(trial, out, workshop, seed, progress, workers=workers)
        progress.phase("report", items=len(EXPERIMENTS))
        with ExperimentResults(out, size, workshop) as material:
            page = write_reports(out, material, on_progress=lambda text: progress.advance(status=text))
    print(f"report: {page}")
    return page


def chosen(only: Sequence[str]) -> list[Experiment]:
    """Experiments by name, all for none; UsageError lists the known ones."""
    for name in only:
        validators.one_of("experiment", name, EXPERIMENTS)
    return [experiment for name, experiment in EXPERIMENTS.items() if not only or name in only]


def size_of(quick: bool, seeds: int | None) -> ScaleConfig:
    """How much is run; ``seeds`` replaces the size's own."""
    size = QUICK if quick else FULL
    return size if seeds is None else size.with_seeds(seeds)


def trials_of(experiments: Sequence[Experiment], size: ScaleConfig) -> list[Trial]:
    """Every trial that an experiment needs and the bench can begin, once, the most important first."""
    by_urgency = sorted(experiments, key=lambda experiment: experiment.urgency)
    needed = {trial.name: trial for experiment in by_urgency for trial in experiment.trials(size)}
    return [trial for trial in needed.values() if trial.start in STARTS and trial.players]


def _phases(trials: Sequence[Trial], workers: int, report_only: bool) -> Mapping[str, float]:
    phases: dict[str, float] = {}
    for trial in trials if not report_only else ():
        phases[f"{trial.name}: models"] = 1.0 + MODEL_S * len(trial.taught) / workers
        phases[trial.name] = trial_seconds(trial) / workers
    return phases | {"report": REPORT_S}


def _check_asked(out: Path, size: ScaleConfig, seed: int) -> None:
    """A folder holds one reproduction: the same call goes on with it, another one is refused."""
    asked = json.loads(json.dumps({"size": asdict(size), "seed": seed}))
    path = out / ASKED
    if not path.exists():
        write_json(path, asked)
        return
    try:
        there = json.loads(path.read_text(encoding="utf-8"))
        before = {name: there[name] for name in asked}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UsageError(f"{path} is no file of a reproduction ({error}); give another --out") from None
    if before != asked:
        raise UsageError(
            f"{out} holds a {before['size']['name']} reproduction with {before['size']['seeds']} seeds from --seed "
            f"{before['seed']}; call it the same way to go on, or give another --out"
        )
