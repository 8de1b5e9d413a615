"""Layflat Bench: its definition and seeds, and scores of made-up episodes; one real episode is a slow test."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from layflat.app.benchmarks.measure import random_model
from layflat.app.commands.benchmark import BenchmarkConfig, run_benchmark
from layflat.app.evaluation.benchmark import HELD_OUT, Benchmark, benchmark, scored, seeds_of, with_scores
from layflat.app.evaluation.plan import plan_policies
from layflat.app.support.errors import UsageError
from layflat.policy import model_io
from layflat.sim.cloth.registry import CLOTHS
from layflat.sim.robots.registry import ROBOTS
from layflat.tests.app.fake_episodes import FakeEpisodes


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the command run a part of the quick part: each episode is a process, if a short one."""

    def part(**options) -> Benchmark:
        whole = benchmark(**options)
        return replace(whole, cloths=whole.cloths[:1], seeds=whole.seeds[:2])

    monkeypatch.setattr("layflat.app.commands.benchmark.benchmark", part)


def run(out: Path, *policies: str, **options) -> list[dict]:
    config = BenchmarkConfig(policies=policies or ("hold", "drag-rule"), out=out, quick=True, **options)
    return run_benchmark(config, workers=3, force=False, make=FakeEpisodes())


@pytest.mark.parametrize("quick", [True, False])
def test_the_definition_can_be_run(quick: bool) -> None:
    bench = benchmark(quick=quick)
    assert re.fullmatch(r"Layflat Bench 1", bench.name)
    assert re.fullmatch(r"1\.\d+", bench.version)
    assert {*bench.robots} == {"hanger", "pickers"} <= {*ROBOTS}
    assert {*bench.cloths} <= {*CLOTHS}
    policies, _ = plan_policies(["scripted"], bench.robots)
    plans = bench.plans(policies)
    assert [*plans] == list(bench.variations) == ["usual", "all"]
    assert not plans["usual"].variation.draws
    assert plans["all"].variation.draws
    assert sum(plan.n_episodes for plan in plans.values()) == (32 if quick else 800)
    whole = benchmark()
    assert {*bench.cloths} <= {*whole.cloths}
    assert {*bench.seeds} <= {*whole.seeds}
    assert {*bench.disturbances} <= {*whole.disturbances}


def test_a_phrase_gives_seeds_that_anyone_can_repeat_and_that_are_none_of_the_published() -> None:
    one, other = benchmark(phrase="a wet Tuesday"), benchmark(phrase="a dry Tuesday")
    assert one == benchmark(phrase="a wet Tuesday")
    assert not {*one.seeds} & {*other.seeds}
    assert all(HELD_OUT <= seed < 2**32 for seed in (*one.seeds, *other.seeds))
    assert all(seed < HELD_OUT for seed in benchmark().seeds)
    expected = int.from_bytes(hashlib.sha256(b"a wet Tuesday\n0").digest()[:4], "big") % 2**31 + 2**31
    assert one.seeds[0] == expected
    assert len({*seeds_of("x", 500)}) == 500
    for empty in ("", "  "):
        with pytest.raises(UsageError, match="--phrase is empty"):
            benchmark(phrase=empty)


def test_one_page_and_one_json_and_the_same_command_runs_nothing_again(tmp_path: Path, capsys) -> None:
    scores = run(tmp_path)
    out = capsys.readouterr().out
    assert "benchmark.json" in out
    assert "benchmark.html" in out
    found = json.loads((tmp_path / "benchmark.json").read_text())
    assert found["schema"] == 1
    assert found["policies"] == scores
    assert found["benchmark"]["version"] == benchmark().version
    assert len(found["benchmark"]["sha256"]) == 64
    assert [entry["policy"] for entry in scores] == sorted(
        ("hold", "drag-rule"), key=lambda name: -next(e["score"] for e in scores if e["policy"] == name)
    )
    for entry in scores:
        assert (entry["n"], entry["starts"]) == (16, 8)
        assert entry["decision_ms"] == pytest.approx(2.0)
        assert entry["demonstrations"] == 0
        assert entry["ci95"][0] <= entry["score"] <= entry["ci95"][1]
        for parts in entry["parts"].values():
            assert sum(part["n"] for part in parts.values()) == 16
            assert np.average(
                [part["score"] for part in parts.values()], weights=[part["n"] for part in parts.values()]
            ) == pytest.approx(entry["score"])
    page = (tmp_path / "benchmark.html").read_text()
    for words in ("Layflat Bench 1, version", "By robot", "By variation", "Against what was drawn", "quick"):
        assert words in page
    rows = {path: path.read_bytes() for path in tmp_path.glob("*/episodes.csv")}
    assert run(tmp_path) == scores
    assert rows == {path: path.read_bytes() for path in tmp_path.glob("*/episodes.csv")}


@pytest.mark.slow
def test_held_out_seeds_go_into_the_same_folder_and_are_counted_alone(tmp_path: Path) -> None:
    published = run(tmp_path, "hold")
    held_out = run(tmp_path, "hold", phrase="behind the mill")
    assert [entry["n"] for entry in held_out] == [16]
    assert {entry["score"] for entry in published} != {entry["score"] for entry in held_out}
    assert json.loads((tmp_path / "benchmark.json").read_text())["benchmark"]["phrase"] == "behind the mill"


@pytest.mark.slow
def test_a_model_runs_on_its_own_robot_and_the_page_says_so(tmp_path: Path) -> None:
    model_io.save(random_model("hanger", 20), tmp_path / "mine.npz")
    scores = run(tmp_path / "out", f"mine={tmp_path / 'mine.npz'}", "hold")
    mine = next(entry for entry in scores if entry["policy"] == "mine")
    assert mine["robots"] == ["hanger"]
    assert (mine["n"], mine["demonstrations"]) == (8, model_io.load(tmp_path / "mine.npz").demonstrations)
    assert "mine was made for hanger and has run with no other robot." in (tmp_path / "out/benchmark.html").read_text()


def test_a_lost_episode_scores_nothing_and_area_is_cut_off_at_the_cloth() -> None:
    rows = pd.DataFrame(
        {
            "flat_area_final": [1.02, -0.4, 0.8, np.nan, 0.5],
            "contact_final": [1.0, 0.3, 0.9, np.nan, 0.5],
            "contact_disturbed": [np.nan] * 5,
            "unstable": [False, False, True, False, False],
            "crashed": [False, False, False, True, False],
            "decision_ms": [1.0, 3.0, np.nan, np.nan, np.nan],
            **{name: ["x"] * 5 for name in ("robot", "cloth", "variation")},
            "seed": [1, 1, 2, 3, 4],
        }
    )
    found = with_scores(rows)
    assert list(found["score"]) == [1.0, 0.0, 0.0, 0.0, 0.5]
    numbers = scored(found)
    assert numbers["score"] == pytest.approx(0.3)
    assert (numbers["n"], numbers["starts"], numbers["lost"]) == (5, 4, 2)
    assert numbers["success_rate"] == 0.2
    assert numbers["decision_ms"] == 2.0


@pytest.mark.slow
def test_a_real_episode_is_scored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    small = replace(benchmark(quick=True), robots=("pickers",), cloths=("napkin",), disturbances=(), seeds=(500_000,))
    monkeypatch.setattr("layflat.app.commands.benchmark.benchmark", lambda **_: small)
    config = BenchmarkConfig(policies=("scripted",), out=tmp_path, quick=True)
    (entry,) = run_benchmark(config, workers=1, force=False)
    assert entry["n"] == 2
    assert entry["score"] > 0.5
    assert 0 < entry["decision_ms"] < 100
