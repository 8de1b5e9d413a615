"""Run what a reproduction needs, the most important first, and write its page."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from layflat.app.evaluation.run import folder_lock
from layflat.app.media.episode_renderer import EpisodeRenderer
from layflat.app.reproduce.artifact_store import ArtifactStore
from layflat.app.reproduce.experiment_results import ExperimentResults
from layflat.app.reproduce.experiments import EXPERIMENTS, Experiment
from layflat.app.reproduce.report import write_reports
from layflat.app.reproduce.studies import FULL, QUICK, ScaleConfig, Trial
from layflat.app.reproduce.trials import expected_core_s, run_trial
from layflat.app.support import validators
from layflat.app.support.errors import UsageError
from layflat.app.support.metrics import write_json
from layflat.app.support.progress import Progress

CONFIG = "reproduction.json"
MODEL_S = 40.0
"""Core-seconds of a model and its share of the demonstrations, for the first estimate of the time left."""
REPORT_S = 60.0


@dataclass(frozen=True, kw_only=True)
class ReproduceConfig:
    """Settings of one `layflat reproduce` call."""

    out: Path
    quick: bool = False
    """Everything with few starts."""
    seeds: int | None = None
    """Starts of each experiment; by default those of the scale."""
    seed: int = 0
    only: tuple[str, ...] = ()
    """Names of the experiments to run; all by default."""
    report_only: bool = False
    """Run nothing; only write the page."""


def reproduce(config: ReproduceConfig, *, workers: int) -> Path:
    """Run what DIR lacks, and write DIR/report.html and DIR/table.md; return the page's path."""
    out = config.out
    for name in config.only:
        validators.one_of("experiment", name, EXPERIMENTS)
    scale = QUICK if config.quick else FULL
    scale = scale if config.seeds is None else scale.with_seeds(config.seeds)
    with folder_lock(out):
        return _reproduce(config, scale, workers)


def _reproduce(config: ReproduceConfig, scale: ScaleConfig, workers: int) -> Path:
    out, seed = config.out, config.seed
    check_config(out, scale, seed)
    store = ArtifactStore(out, seed=seed)
    trials = trials_of([EXPERIMENTS[name] for name in config.only or EXPERIMENTS], scale)
    with Progress(_phases(() if config.report_only else trials, workers)) as progress:
        for trial in () if config.report_only else trials:
            progress.phase(f"{trial.name}: models", items=len(trial.policies))
            store.build(trial.models, progress, workers=workers)
            progress.phase(trial.name, items=trial.episodes)
            run_trial(trial, out, store, seed, progress, workers=workers)
        progress.phase("report")
        with EpisodeRenderer() as renderer:
            results = ExperimentResults(out, scale, store, renderer)
            page = write_reports(out, results, on_progress=progress.advance)
    print(f"report: {page}")
    return page


def trials_of(experiments: Sequence[Experiment], scale: ScaleConfig) -> list[Trial]:
    """Return every trial that the experiments need, once, the most important first."""
    by_priority = sorted(experiments, key=lambda experiment: experiment.priority)
    needed = {trial.name: trial for experiment in by_priority for trial in experiment.plan(scale)}
    return list(needed.values())


def check_config(out: Path, scale: ScaleConfig, seed: int) -> None:
    """Write the folder's configuration, or raise UsageError where it holds another reproduction."""
    config = json.loads(json.dumps({"scale": asdict(scale), "seed": seed}))
    path = out / CONFIG
    if not path.exists():
        write_json(path, config)
        return
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        before = {name: content[name] for name in config}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UsageError(f"{path} is no file of a reproduction ({error}); give another --out") from None
    if before != config:
        raise UsageError(
            f"{out} holds a {before['scale']['name']} reproduction with {before['scale']['seeds']} seeds from --seed "
            f"{before['seed']}; give the same options to continue it, or another --out"
        )


def _phases(trials: Sequence[Trial], workers: int) -> Mapping[str, float]:
    phases: dict[str, float] = {}
    for trial in trials:
        phases[f"{trial.name}: models"] = 1.0 + MODEL_S * len(trial.models) / workers
        phases[trial.name] = expected_core_s(trial) / workers
    return phases | {"report": REPORT_S}
