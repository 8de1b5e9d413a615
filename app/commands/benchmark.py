"""`layflat benchmark`: Layflat Bench 1, one page and one JSON."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from layflat.app.commands.evaluate import CASE_S, EPISODE_S
from layflat.app.evaluation.benchmark import benchmark, planned_rows, scores_of, with_scores
from layflat.app.evaluation.plan import plan_policies
from layflat.app.evaluation.run import folder_lock, run_evaluation
from layflat.app.report.benchmark_page import benchmark_page, ranking_table
from layflat.app.report.page import write_page
from layflat.app.support.console import print_table
from layflat.app.support.errors import LayflatError, say
from layflat.app.support.metrics import write_json
from layflat.app.support.progress import Progress
from layflat.app.support.seeds import taught_text
from layflat.app.workers.simulated_episode import EpisodeFactory, SimulatedEpisode
from layflat.data.provenance import capture_provenance, git_revision

JSON, PAGE = "benchmark.json", "benchmark.html"
REPORT_S = 5.0
WIDTH = 200


@dataclass(frozen=True, kw_only=True)
class BenchmarkConfig:
    """Settings of one `layflat benchmark` call."""

    policies: tuple[str, ...]
    """POLICY texts, see `layflat.policy.spec.PolicySpec.parse`."""
    out: Path
    quick: bool = False
    phrase: str | None = None
    """Text from which held-out seeds follow; None: the published ones."""


def run_benchmark(
    config: BenchmarkConfig, *, workers: int, force: bool, make: EpisodeFactory = SimulatedEpisode
) -> list[dict[str, Any]]:
    """Run what the folder does not hold yet; print the scores, write the page and the JSON, and return the scores."""
    bench = benchmark(quick=config.quick, phrase=config.phrase)
    policies, _ = plan_policies(config.policies, bench.robots)
    plans = bench.plans(policies)
    phases = {
        f"conditions {name}": plan.n_episodes / len(plan.all_cases) * (EPISODE_S + CASE_S * len(plan.cases)) / workers
        for name, plan in plans.items()
    }
    taught = {(entry["policy"], tuple(entry["seeds"])) for plan in plans.values() for entry in plan.taught}
    for policy, seeds in sorted(taught):
        say(taught_text(policy, seeds))
    found = []
    with folder_lock(config.out), Progress(phases | {"report": REPORT_S}) as progress:
        for name, plan in plans.items():
            progress.phase(f"conditions {name}", items=plan.n_episodes)
            results = run_evaluation(
                plan, config.out / name, workers=workers, force=force, progress=progress, make=make
            )
            found.append(planned_rows(results.rows, plan).assign(variation=name))
        progress.phase("report")
        rows = with_scores(pd.concat(found, ignore_index=True))
        scores = scores_of(rows, policies)
        provenance = {**vars(capture_provenance()), "git": git_revision()}
        write_json(config.out / JSON, {"benchmark": bench.described(), "policies": scores, "provenance": provenance})
        versions = ", ".join(f"{name} {number}" for name, number in provenance["versions"].items())
        made = (provenance["command"], f"{provenance['created_utc']} (UTC), {provenance['platform']}", versions)
        write_page(config.out / PAGE, benchmark_page(bench, rows, scores, made))
    table = ranking_table(scores)
    print_table(table.header, table.rows, title=bench.title, left=2, width=WIDTH)
    print(f"scores: {config.out / JSON}")
    print(f"page: {config.out / PAGE}")
    if rows["crashed"].all():
        raise LayflatError(f"every episode crashed; the first: {rows['reason'].iloc[0]}")
    return scores
