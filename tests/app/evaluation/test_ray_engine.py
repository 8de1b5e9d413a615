"""The Ray engine on a real cluster of two nodes on one machine: the same rows, and what is lost is tried again."""

from __future__ import annotations

import os
import secrets
import signal
import sys
import time

import pandas as pd
import psutil
import pytest

from layflat.app.evaluation.plan import EvaluationPlan
from layflat.app.evaluation.ray_engine import ray_engine
from layflat.app.evaluation.results import EvaluationResults
from layflat.app.evaluation.run import run_evaluation
from layflat.app.evaluation.suites import cases_of
from layflat.app.support.errors import LayflatError
from layflat.app.workers.fork_server import ForkServer
from layflat.policy.spec import PolicySpec
from layflat.tests.app.fake_episodes import PLACING, FakeEpisodes, fake_plan, key_of


def test_without_ray_there_is_one_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(LayflatError, match=r"needs Ray, which is not installed; pip install 'layflat\[ray\]'"):
        ray_engine(2, None)


def test_a_fork_server_runs_item_after_item_and_ends_with_its_owner():
    server = ForkServer()
    try:
        for item in fake_plan(seeds=1).items():
            faults = {(key_of(item), "push"): ("segfault",)}
            end, files = server.run(item, FakeEpisodes(faults))
            assert set(end.lost) == {item.run_ids[1]}
            assert set(files) == set(end.rows) == set(item.run_ids) - {item.run_ids[1]}
        process = psutil.Process(server._process.pid)
    finally:
        server.close()
    assert not process.is_running()


@pytest.fixture(scope="module")
def cluster():
    """Address of a Ray cluster of two nodes of one core each, as on two machines: each has workers of its own."""
    # From 2.61 on every Ray cluster wants a token, and before it some do.
    os.environ.update(RAY_USAGE_STATS_ENABLED="0", RAY_AUTH_MODE="token", RAY_AUTH_TOKEN=secrets.token_hex(32))
    pytest.importorskip("ray", reason="Ray is an optional extra")
    from ray.cluster_utils import Cluster

    two = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    two.add_node(num_cpus=1)
    yield two.address
    two.shutdown()


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_two_nodes_give_the_rows_of_one_machine(cluster, tmp_path):
    plan = fake_plan(seeds=6)
    faults = {(key_of(item), PLACING): ("kill", None) for item in list(plan.items())[3:6]}
    there = run_evaluation(plan, tmp_path / "ray", engine=ray_engine(2, cluster), make=FakeEpisodes(faults))
    here = run_evaluation(plan, tmp_path / "local", workers=2, make=FakeEpisodes(faults))
    pd.testing.assert_frame_equal(there.rows, here.rows)
    assert (there.rows["attempts"] == 2).sum() == 9


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_lost_worker_costs_what_it_was_at(cluster, tmp_path):
    plan = fake_plan(seeds=8)
    killed: list[int] = []

    class Killing:
        def advance(self, amount: float = 1.0, status: str = "") -> None:
            for process in psutil.process_iter(["cmdline"]):
                words = process.info["cmdline"] or [""]
                if words[0].startswith("ray::run_on_node") and len(killed) < 3 and process.pid not in killed:
                    process.send_signal(signal.SIGKILL)
                    killed.append(process.pid)
                    return

    make = FakeEpisodes(step_s=0.2)
    results = run_evaluation(plan, tmp_path, engine=ray_engine(2, cluster), make=make, progress=Killing())  # type: ignore[arg-type]
    assert killed
    assert len(results.rows) == plan.n_episodes
    assert results.rows["run"].is_unique
    assert (results.rows["attempts"] == 2).any()
    give_up = time.monotonic() + 10
    while _servers() and time.monotonic() < give_up:
        time.sleep(0.1)
    assert not _servers()


def _servers() -> list[int]:
    return [
        p.pid
        for p in psutil.process_iter(["cmdline"])
        if "layflat.app.workers.fork_server" in (p.info["cmdline"] or [])
    ]


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_real_episodes_are_the_same_on_one_worker_on_two_and_on_ray(cluster, tmp_path, differences):
    plan = EvaluationPlan(
        policies=(PolicySpec(builtin="drag-rule"), PolicySpec(builtin="hold")),
        robots=("hanger", "pickers"),
        cloths=("towel",),
        seeds=(0, 1),
        cases=cases_of("poke"),
    )
    engines = {"one": {"workers": 1}, "two": {"workers": 2}, "ray": {"engine": ray_engine(2, cluster)}}
    results = {name: run_evaluation(plan, tmp_path / name, **options) for name, options in engines.items()}
    rows = {name: found.rows.drop(columns="wall_s") for name, found in results.items()}
    for name in ("two", "ray"):
        pd.testing.assert_frame_equal(rows["one"], rows[name])
        for run in rows["one"]["run"]:
            assert _steps_differ(results["one"], results[name], run, differences) == []


def _steps_differ(a: EvaluationResults, b: EvaluationResults, run: str, differences) -> list[str]:
    return differences(a.episode(run).steps, b.episode(run).steps)
