"""The share of the work is that of the time, within episodes too."""

from __future__ import annotations

import io
import time
from itertools import pairwise

import pytest

from layflat.app.support.progress import Progress
from layflat.app.workers.item_progress import ItemProgress, RunningItem
from layflat.app.workers.run_items import collect_items, demonstrations
from layflat.app.workers.work_item import NO_DISTURBANCE, DisturbanceCase, WorkItem
from layflat.policy.spec import PolicySpec
from layflat.sim.config import SimConfig
from layflat.tests.app.fake_episodes import FakeEpisodes

CONFIG = SimConfig(robot="hanger", cloth="napkin")
PUSH = DisturbanceCase(name="push")


def plan(seeds, *, policies=("hold",), cases=(NO_DISTURBANCE,)):
    specs = [PolicySpec.parse(policy) for policy in policies]
    return [WorkItem(policy=p, config=CONFIG, seed=seed, cases=cases) for seed in seeds for p in specs]


@pytest.mark.parametrize("workers", [1, 2, 3])
@pytest.mark.parametrize("count", [2, 3, 8])
@pytest.mark.parametrize("steps", [30, 80, 400])
def test_the_time_left_is_right_after_a_quarter(workers, count, steps):
    """Episodes of equal length, longer or shorter than expected, on some workers; a step takes 0.05 s."""
    clock, waiting, running, found = [0.0], plan(range(count)), {}, []
    with Progress({"a": 20.0}, stream=io.StringIO(), clock=lambda: clock[0]) as progress:
        progress.phase("a", items=count)
        episodes = ItemProgress(progress, count)
        while waiting or running:
            while waiting and len(running) < workers:
                item = waiting.pop(0)
                running[item.seed] = [item, -10]  # a start takes as long as some steps
            for entry in running.values():
                entry[1] += 1
            clock[0] += 0.05
            episodes.show_running([RunningItem(item, max(done, 0)) for item, done in running.values()])
            found.append((clock[0], progress.share, clock[0] + progress.remaining_s()))
            for seed in [seed for seed, (_, done) in running.items() if done == steps]:
                del running[seed]
                episodes.finish(1, "")
        end_s = clock[0]
    shares = [share for _, share, _ in found]
    assert shares == sorted(shares)
    assert max(b - a for a, b in pairwise(shares)) < (0.2 if steps == 80 else 0.5)
    # The length of an episode is not known before the first one ends.
    known_s = 0.25 * end_s if steps == 80 else max(0.25 * end_s, 0.05 * (steps + 15))
    late = [end for now_s, _, end in found if now_s >= known_s]
    assert all(0.7 * end_s < end < 1.3 * end_s for end in late)


def test_an_item_of_several_cases_counts_as_its_episodes():
    with Progress({"a": 1.0}, stream=io.StringIO()) as progress:
        progress.phase("a", items=4)
        first, second = plan(range(2), cases=(NO_DISTURBANCE, PUSH))
        episodes = ItemProgress(progress, 4)
        episodes.show_running([RunningItem(first, 40)])
        assert 0.1 < episodes.share < 0.25
        episodes.show_running([RunningItem(second, 0)])
        assert episodes.share == pytest.approx(0.5)
        episodes.finish(2, "both cases")
        assert episodes.share == pytest.approx(0.5)


def test_the_bar_moves_within_episodes_that_run_in_processes(tmp_path, monkeypatch):
    shares: list[tuple[float, float]] = []
    with Progress({"a": 3.0}, stream=io.StringIO()) as progress:
        monkeypatch.setattr(progress, "within", lambda share: shares.append((time.monotonic(), share)))
        progress.phase("a", items=2)
        items = demonstrations(CONFIG, range(2))
        collect_items(items, tmp_path, progress, workers=1, make=FakeEpisodes(step_s=0.06))
    values = [share for _, share in shares]
    assert values == sorted(values)
    assert sum(0 < share < 0.5 for share in values) >= 2
    assert sum(0.5 < share < 1 for share in values) >= 2
