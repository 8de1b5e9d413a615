"""Speed of an evaluation: the same small one with one worker and with two."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from layflat.app.benchmarks.rows import BenchmarkRow, Samples
from layflat.app.evaluation.plan import EvaluationPlan
from layflat.app.evaluation.run import run_evaluation
from layflat.app.support.errors import LayflatError
from layflat.app.workers.simulated_episode import EpisodeFactory, SimulatedEpisode
from layflat.data.arrays import FloatArray
from layflat.policy.spec import SCRIPTED, PolicySpec

WORKERS = (1, 2)
EPISODES = 4
"""Scripted placements; a multiple of the most workers, so that none waits for the last."""


def scaling(
    robot: str,
    cloth: str,
    folder: Path | None = None,
    make: EpisodeFactory = SimulatedEpisode,
    episodes: int = EPISODES,
) -> dict[str, FloatArray]:
    """Measure wall s per episode, by the number of workers; the rows are written to ``folder``'s disk.

    Call it in a process that has stepped no simulation: the workers are forked from it.
    """
    plan = EvaluationPlan(
        policies=(PolicySpec(builtin=SCRIPTED),), robots=(robot,), cloths=(cloth,), seeds=tuple(range(episodes))
    )
    walls = {}
    for workers in WORKERS:
        with tempfile.TemporaryDirectory(prefix=".layflat-bench-", dir=folder) as place:
            began = time.perf_counter()
            results = run_evaluation(plan, Path(place), workers=workers, make=make)
            walls[str(workers)] = np.array([(time.perf_counter() - began) / episodes])
            if (lost := int(results.rows["crashed"].sum())) > 0:
                raise LayflatError(f"{lost} of {episodes} episodes of the benchmark's evaluation crashed")
    return walls


def rows(samples: Samples, before: Mapping[str, float]) -> list[BenchmarkRow]:
    """Return the episodes a minute of the most workers, beside those of one."""
    few, many = (60 / float(samples[str(workers)][0]) for workers in WORKERS)
    name = f"batch of {EPISODES}, {WORKERS[-1]} workers / 1"
    return [BenchmarkRow(name=name, value=many, unit="episodes / min", baseline=few)]
