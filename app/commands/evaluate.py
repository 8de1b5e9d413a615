"""`layflat evaluate` and `layflat disturb`: policies compared from the same starts, with the same disturbances."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import pandas as pd

from layflat.app.evaluation.paired import CONDITION
from layflat.app.evaluation.plan import EvaluationPlan, plan_policies
from layflat.app.evaluation.ray_engine import ray_engine
from layflat.app.evaluation.results import EvaluationResults
from layflat.app.evaluation.run import folder_lock, run_evaluation
from layflat.app.evaluation.suites import cases_of
from layflat.app.report.comparison_sentences import paired_table
from layflat.app.report.evaluation_page import PageOptions, write_evaluation
from layflat.app.report.examples import FILMS
from layflat.app.report.policies import policies_of
from layflat.app.report.result_tables import group_table
from layflat.app.support import validators
from layflat.app.support.console import print_table
from layflat.app.support.errors import LayflatError, UsageError, say
from layflat.app.support.progress import Progress
from layflat.app.support.seeds import EVALUATION_SEED, taught_text
from layflat.app.workers.sim_options import parse_variation
from layflat.app.workers.work_item import LIMIT_S
from layflat.app.workers.worker_process import Engine, local_engine
from layflat.sim.cloth.spec import DEFAULT_CLOTH
from layflat.sim.tasks import DEFAULT_TASK

EPISODE_S = 12.0
CASE_S = 6.0
REPORT_S, FILMS_S = 4.0, 12.0
"""Core-seconds of a placement, of what follows in each case, of the page, and of its films, for the first estimate."""
ENGINES = ("local", "ray")
WIDTH = 200
"""Columns of a table in a file: a cut word is of no use there."""


@dataclass(frozen=True, kw_only=True)
class EvaluateConfig:
    """Settings of one `layflat evaluate` call."""

    policies: tuple[str, ...]
    """POLICY texts, see `layflat.policy.spec.PolicySpec.parse`."""
    out: Path
    episodes: int = 20
    seed: int = EVALUATION_SEED
    disturb: tuple[str, ...] = ()
    """Suites, disturbances or files of suites."""
    cloths: tuple[str, ...] = ()
    """By default those of the models."""
    robots: tuple[str, ...] = ()
    """By default those of the models."""
    task: str = DEFAULT_TASK
    start: str | None = None
    """By default that of the task."""
    settings: tuple[str, ...] = ()
    """Conditions, KEY=VALUE."""
    vary: tuple[str, ...] = ()
    """Names or files of variations."""
    limit_s: float = LIMIT_S
    engine: str = ENGINES[0]
    address: str | None = None
    videos: bool | None = None
    """Films of all examples, or of none; by default of some typical and worst episodes."""


def evaluate(config: EvaluateConfig, *, workers: int, force: bool) -> EvaluationResults:
    """Run the policies from the starts of ``seed``, ``seed + 1``, ...; print a table, write all else into ``out``."""
    policies, robots = plan_policies(config.policies, config.robots)
    trained = dict.fromkeys(policy.model.cloth for policy in policies if policy.model is not None)
    plan = EvaluationPlan(
        policies=policies,
        robots=robots,
        cloths=tuple(config.cloths or trained or [DEFAULT_CLOTH]),
        seeds=tuple(config.seed + k for k in range(config.episodes)),
        cases=tuple(case for text in config.disturb for case in cases_of(text)),
        task=config.task,
        start=config.start,
        settings=config.settings,
        variation=parse_variation(config.vary, config.settings),
        limit_s=config.limit_s,
    )
    for taught in plan.taught:
        say(taught_text(taught["policy"], taught["seeds"]))
    engine = engine_of(config.engine, workers, config.address)
    seconds = len(plan.seeds) * len(plan.cloths) * len(plan.entries) * (EPISODE_S + CASE_S * len(plan.cases))
    report_s = REPORT_S if config.videos is False else REPORT_S + FILMS_S
    with folder_lock(config.out), Progress({"episodes": seconds / workers, "report": report_s}) as progress:
        progress.phase("episodes", items=plan.n_episodes)
        results = run_evaluation(plan, config.out, engine=engine, force=force, progress=progress, locked=True)
        progress.phase("report")
        options = PageOptions(films={None: FILMS, True: None, False: 0}[config.videos])
        page = write_evaluation(results, options, on_progress=progress.advance)
    print_results(results.rows)
    print(f"results: {config.out}")
    print(f"report: {page}")
    if results.rows["crashed"].all():
        raise LayflatError(f"every episode crashed; the first: {results.rows['reason'].iloc[0]}")
    return results


def engine_of(name: str, workers: int, address: str | None) -> Engine:
    """Return the engine of that name; UsageError for another one, or an address without a cluster."""
    if validators.one_of("engine", name, ENGINES) == "ray":
        return ray_engine(workers, address)
    if address is not None:
        raise UsageError("--address is the address of a Ray cluster; give --engine ray with it")
    return local_engine(workers)


def print_results(rows: pd.DataFrame) -> None:
    """Print one line for each policy and one for each difference, for every condition."""
    for key, part in rows.groupby(list(CONDITION), sort=False):
        groups, policies = group_table(part), policies_of(part)
        print_table(groups.header, groups.rows, title=", ".join(key), left=1, width=WIDTH)
        pairs = paired_table(part, [(b, a) for a, b in combinations(policies, 2)])
        if pairs.rows:
            print_table(pairs.header, pairs.rows, left=2, width=WIDTH)
