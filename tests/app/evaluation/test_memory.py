"""An evaluation streams to the disk: its memory does not grow with its episodes."""

from __future__ import annotations

import time
from dataclasses import replace

import psutil
import pytest

from layflat.app.evaluation import results_csv
from layflat.app.evaluation.plan import EvaluationPlan
from layflat.app.evaluation.run import run_evaluation
from layflat.app.support.metrics import episode_metrics
from layflat.app.workers.work_item import DisturbanceCase, WorkResult
from layflat.policy.schedule import ScheduledDisturbance
from layflat.sim.disturbances.presets import DISTURBANCES
from layflat.tests.app.fake_episodes import FakeEpisodes, fake_episode, fake_plan

pytestmark = pytest.mark.slow

TEN_THOUSAND = 10_000
BYTES_A_ROW = 400
"""What a row may leave in memory: its run's name takes 130; the row itself would take 700 more, its episode 10,000."""


class Memory:
    """Resident memory and open files of this process, at the first row and after every 500."""

    def __init__(self) -> None:
        self.done = 0
        self.began_s = time.monotonic()
        self.seen: dict[int, int] = {}
        self.files: dict[int, int] = {}

    def advance(self, amount: float = 1.0, status: str = "") -> None:
        self.done += int(amount)
        if self.done == 1 or self.done % 500 == 0:
            process = psutil.Process()
            self.seen[self.done], self.files[self.done] = process.memory_info().rss, process.num_fds()
            took_s = time.monotonic() - self.began_s
            print(f"{self.done} rows, {took_s:.0f} s: {self.seen[self.done] / 1e6:.1f} MB", flush=True)

    def check_flat(self) -> None:
        """No episode and no row is kept, and no pipe of a item that has ended."""
        assert max(self.seen) == TEN_THOUSAND
        # What the first items load and allocate for good is not growth.
        grown = max(self.seen.values()) - self.seen[500]
        assert grown < BYTES_A_ROW * (TEN_THOUSAND - 500)
        assert self.files[TEN_THOUSAND] <= self.files[500]


def _ten_thousand() -> EvaluationPlan:
    """Ten episodes of each placing, so that most of the time goes into episodes and not into placings."""
    push = ScheduledDisturbance(disturbance=DISTURBANCES["push"])
    plan = replace(
        fake_plan(seeds=500),
        cases=tuple(DisturbanceCase(name=f"push-{number}", schedule=(push,)) for number in range(1, 10)),
    )
    assert plan.n_episodes == TEN_THOUSAND
    return plan


def _at_once(next_group, folder, make):
    """An engine without processes: what an evaluation keeps is in this one."""
    while (item := next_group()) is not None:
        rows = {
            run: episode_metrics(fake_episode(item, case)) for run, case in zip(item.run_ids, item.cases, strict=True)
        }
        yield WorkResult(item, {}, rows)


def test_ten_thousand_episodes_keep_no_more_in_memory_than_five_hundred(tmp_path, monkeypatch):
    monkeypatch.setattr(results_csv.os, "fsync", lambda descriptor: None)  # Of memory, not of the disk.
    memory = Memory()
    results = run_evaluation(_ten_thousand(), tmp_path, engine=_at_once, progress=memory)  # type: ignore[arg-type]
    assert len(results.rows) == TEN_THOUSAND
    memory.check_flat()


@pytest.mark.timeout(3600)
def test_ten_thousand_real_processes_in_flat_memory(tmp_path):
    memory = Memory()
    results = run_evaluation(_ten_thousand(), tmp_path, workers=2, make=FakeEpisodes(), progress=memory)  # type: ignore[arg-type]
    assert len(results.rows) == TEN_THOUSAND
    assert results.rows["run"].is_unique
    assert not results.rows["crashed"].any()
    assert len(list((tmp_path / "runs").glob("*.h5"))) == TEN_THOUSAND
    memory.check_flat()
