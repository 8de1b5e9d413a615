"""What `layflat bench` measures of batches: the same small batch with one worker and with two."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np

from layflat.app.evaluation.plan import EvaluationPlan, PolicySpec
from layflat.app.evaluation.run import run_batch
from layflat.app.evaluation.simulated_episode import SimulatedEpisode
from layflat.app.evaluation.work_item import EpisodeFactory
from layflat.app.support.errors import LayflatError
from layflat.app.workers.make_policy import SCRIPTED
from layflat.data.arrays import FloatArray

WORKERS = (1, 2)
EPISODES = 4
"""Scripted placings; a multiple of the most workers, so that none waits for the last."""


def scaling(
    robot: str,
    cloth: str,
    folder: Path | None = None,
    play: EpisodeFactory = SimulatedEpisode,
    episodes: int = EPISODES,
) -> dict[str, FloatArray]:
    """Wall s per episode, by the number of workers; the rows are written to ``folder``'s disk.

    Call it in a process that has stepped no simulation: the workers are forked from it.
    """
    plan = EvaluationPlan(
        entrants=(PolicySpec(name=SCRIPTED, robot=robot, made=SCRIPTED),), cloths=(cloth,), seeds=tuple(range(episodes))
    )
    walls = {}
    for workers in WORKERS:
        with tempfile.TemporaryDirectory(prefix=".layflat-bench-", dir=folder) as place:
            began = time.perf_counter()
            results = run_batch(plan, Path(place), workers=workers, play=play)
            walls[str(workers)] = np.array([(time.perf_counter() - began) / episodes])
            if (lost := int(results.rows["crashed"].sum())) > 0:
                raise LayflatError(f"{lost} of {episodes} episodes of the benchmark's batch crashed")
    return walls
