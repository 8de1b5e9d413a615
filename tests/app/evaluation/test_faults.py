"""Faults of workers and of the program itself: no row is lost, and none is there twice."""

from __future__ import annotations

import contextlib
import itertools
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import psutil
import pytest

from layflat.app.evaluation.plan import EvaluationPlan
from layflat.app.evaluation.results import EvaluationResults
from layflat.app.evaluation.run import run_evaluation
from layflat.app.support.errors import LayflatError
from layflat.app.support.metrics import COLUMNS, episode_metrics
from layflat.data.atomic_files import WriterLock
from layflat.tests.app.fake_episodes import FAULTS, PLACING, FakeEpisodes, Fault, fake_episode, fake_plan, key_of
from layflat.tests.app.program import Program

DISK_SHARE, HANG_SHARE = 0.04, 0.05
LIMIT_S = 4.0
"""A hang takes that long; an episode that is well must never."""


def _faults(
    plan: EvaluationPlan, wanted: int, rng: np.random.Generator
) -> dict[tuple[str, str], tuple[Fault | None, ...]]:
    """``wanted`` faults at random places of the plan's first and second attempts."""
    ordinary = [fault for fault in FAULTS if fault not in ("disk", "hang")]
    planned: dict[tuple[str, str], tuple[Fault | None, ...]] = {}
    places = [
        (key_of(item), where) for item in plan.items() for where in (PLACING, *(case.name for case in item.cases))
    ]
    rng.shuffle(places)
    for place in map(tuple, places):
        if sum(map(len, planned.values())) >= wanted:
            break
        one: Fault = rng.choice(["disk", "hang", *ordinary], p=_shares(len(ordinary)))
        # A second fault in the same place makes a crashed row; a disk is full once, and then somebody makes room.
        again = rng.uniform() < 0.3 and one != "disk"
        planned[place] = (one, rng.choice(ordinary)) if again else (one,)
    return planned


def _shares(ordinary: int) -> list[float]:
    return [DISK_SHARE, HANG_SHARE, *[(1 - DISK_SHARE - HANG_SHARE) / ordinary] * ordinary]


def _until_done(plan: EvaluationPlan, out: Path, make: FakeEpisodes, workers: int) -> tuple[EvaluationResults, int]:
    """As a person would: the same command again, with room made, until it ends well; how often the disk was full."""
    for full in itertools.count():
        with contextlib.suppress(LayflatError):
            return run_evaluation(plan, out, workers=workers, make=make), full
    raise AssertionError


def _check(plan: EvaluationPlan, results: EvaluationResults) -> Counter:
    """Each planned row once, each as it must be; which ends there were."""
    rows = results.rows.set_index("run")
    assert rows.index.is_unique
    assert list(rows.index) == [run for item in plan.items() for run in item.run_ids]
    for item in plan.items():
        for case, run in zip(item.cases, item.run_ids, strict=True):
            row, file = rows.loc[run], results.folder / "runs" / f"{run}.h5"
            if row["crashed"]:
                assert row["attempts"] == 2
                assert row["reason"]
                assert not file.exists()
            else:
                made = replace(fake_episode(item, case), source=item.policy.label, disturbance=case.name)
                assert {name: None if pd.isna(row[name]) else row[name] for name in COLUMNS} == episode_metrics(made)
                assert file.exists()
    return Counter(rows["reason"])


def _inject(out: Path, count: int, items: int, workers: int, seed: int) -> None:
    plan = fake_plan(seeds=items // 2, limit_s=LIMIT_S)
    faults = _faults(plan, count, np.random.default_rng(seed))
    injected = Counter(fault for given in faults.values() for fault in given)
    assert sum(injected.values()) >= count
    assert set(injected) == set(FAULTS)
    results, full = _until_done(plan, out / "out", FakeEpisodes(faults, marks=out), workers)
    reasons = _check(plan, results)
    print(f"injected {dict(injected)}; disk full {full} times; crashed rows by reason: {dict(reasons)}")
    assert full > 0
    assert (results.rows["attempts"] == 2).sum() > count / 4


def test_a_hundred_faults_lose_no_row_and_double_none(tmp_path):
    _inject(tmp_path, 100, items=60, workers=8, seed=1)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_thousand_faults_lose_no_row_and_double_none(tmp_path):
    _inject(tmp_path, 1000, items=500, workers=8, seed=2)


@pytest.fixture
def start(start_program, tmp_path):
    """``start(seeds, workers, step_s)``: an evaluation as a program."""

    def run(seeds: int = 6, workers: int = 2, step_s: float = 0.3) -> Program:
        return start_program("layflat.tests.app.fake_episodes", tmp_path / "out", seeds, workers, step_s)

    return run


def _check_continues(seeds: int, tmp_path: Path) -> None:
    """The same command gives the rows of an evaluation that was never disturbed."""
    rows = run_evaluation(fake_plan(seeds), tmp_path / "out", workers=4, make=FakeEpisodes()).rows
    whole = run_evaluation(fake_plan(seeds), tmp_path / "whole", workers=4, make=FakeEpisodes()).rows
    pd.testing.assert_frame_equal(rows, whole)


def test_kill_9_leaves_no_process_and_the_same_command_continues(start, tmp_path):
    program = start()
    program.until("4/36")
    # Between two items there may be none for a moment; killed are those that are at work.
    program.until(lambda: len(program.running()) > 2)
    program.kill()
    assert program.none_left()
    with WriterLock(tmp_path / "out" / ".running", tmp_path):  # Nothing holds the folder.
        pass
    kept = pd.read_csv(tmp_path / "out" / "episodes.csv")
    assert len(kept) >= 4
    files = {path: path.stat().st_mtime_ns for path in (tmp_path / "out" / "runs").glob("*.h5")}
    assert {f"{run}.h5" for run in kept["run"]} <= {path.name for path in files}
    _check_continues(6, tmp_path)
    assert {path: path.stat().st_mtime_ns for path in files} == files


def test_ctrl_c_keeps_and_summarizes_what_is_finished_and_ends_with_130(start, tmp_path):
    program = start()
    program.until("3/36")
    program.interrupt()
    results = EvaluationResults.open(tmp_path / "out")
    assert 3 <= len(results.rows) < 36
    assert not results.rows["crashed"].any()
    assert sum(group["n"] for group in results.summary["groups"]) == len(results.rows)
    _check_continues(6, tmp_path)


@pytest.mark.slow
def test_an_evaluation_that_is_killed_again_and_again_comes_to_its_end(start, tmp_path):
    rng = np.random.default_rng(0)
    for _ in range(15):
        program = start(seeds=12, workers=3, step_s=0.05)
        time.sleep(2.0 + rng.uniform(0.0, 3.0))
        program.kill()
        assert program.none_left()
    assert start(seeds=12, workers=3, step_s=0.0).wait() == 0
    before = EvaluationResults.open(tmp_path / "out").rows
    _check_continues(12, tmp_path)
    pd.testing.assert_frame_equal(EvaluationResults.open(tmp_path / "out").rows, before)


def test_killed_workers_are_replaced(start, tmp_path):
    """From outside, at any moment, as when memory runs out."""
    program = start(seeds=6, workers=2, step_s=0.3)
    program.until("1/36")
    for _ in range(5):
        workers = [process for process in program.running() if process.pid != program.process.pid]
        with contextlib.suppress(psutil.NoSuchProcess):
            for process in workers[:1]:
                process.kill()
        time.sleep(0.4)
    assert program.wait(60) == 0
    rows = EvaluationResults.open(tmp_path / "out").rows
    assert len(rows) == 36
    assert rows["run"].is_unique
    assert (rows["attempts"] == 2).any()
