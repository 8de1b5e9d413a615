"""Evaluations without a simulation: which rows come, in which order, and how a folder is continued."""

from __future__ import annotations

import errno
import json
import os
from dataclasses import replace

import cv2
import numpy as np
import pandas as pd
import pytest

from layflat.app.evaluation import results_csv
from layflat.app.evaluation.plan import EvaluationPlan
from layflat.app.evaluation.results import EvaluationResults
from layflat.app.evaluation.run import run_evaluation
from layflat.app.support.errors import LayflatError, UsageError
from layflat.app.support.metrics import COLUMNS, episode_metrics
from layflat.app.workers.work_item import DisturbanceCase
from layflat.data import validate
from layflat.data.atomic_files import WriterLock
from layflat.data.errors import DataError
from layflat.data.session.reader import open_session
from layflat.policy.model_io import load, save
from layflat.policy.schedule import ScheduledDisturbance
from layflat.policy.spec import PolicySpec
from layflat.sim.disturbances.presets import DISTURBANCES
from layflat.tests.app.fake_episodes import PLACING, FakeEpisodes, OpencvEpisodes, fake_episode, fake_plan, key_of

FAKE = FakeEpisodes()


def _run(plan: EvaluationPlan, out, **options) -> EvaluationResults:
    return run_evaluation(plan, out, **{"workers": 3, "make": FAKE, **options})


def _wanted(plan: EvaluationPlan) -> list[str]:
    return [run for item in plan.items() for run in item.run_ids]


def test_every_policy_meets_every_start_and_every_case_once(tmp_path):
    plan = fake_plan(seeds=3)
    rows = _run(plan, tmp_path).rows
    met = {name: set(zip(item["seed"], item["disturbance"], strict=True)) for name, item in rows.groupby("policy")}
    assert met["hold"] == met["drag-rule"]
    assert met["hold"] == {(seed, case) for seed in range(3) for case in ("none", "push", "mix/early")}
    assert len(rows) == plan.n_episodes == 18
    assert list(rows.columns[: len(COLUMNS)]) == list(COLUMNS)


def test_rows_are_those_of_the_episodes_in_the_plans_order_with_any_number_of_workers(tmp_path):
    plan = fake_plan(seeds=3)
    many, one = (_run(plan, tmp_path / name, workers=n).rows for name, n in (("many", 5), ("one", 1)))
    pd.testing.assert_frame_equal(many, one)
    assert (tmp_path / "many" / "episodes.csv").read_bytes() == (tmp_path / "one" / "episodes.csv").read_bytes()
    assert list(many["run"]) == _wanted(plan)
    item = next(plan.items())
    for case, (_, row) in zip(item.cases, many.iterrows(), strict=False):
        expected = episode_metrics(replace(fake_episode(item, case), source="hold", disturbance=case.name))
        assert {name: None if pd.isna(row[name]) else row[name] for name in COLUMNS} == expected


def test_every_episode_is_a_session_that_says_who_and_what(tmp_path):
    results = _run(fake_plan(seeds=1), tmp_path)
    for run, policy, case in results.rows[["run", "policy", "disturbance"]].itertuples(index=False):
        episode = results.episode(run)
        assert (episode.source, episode.disturbance, episode.seed) == (policy, case, 0)
        assert validate(tmp_path / "runs" / f"{run}.h5") == ()
    files = ["columns.json", "config.json", "episodes.csv", "runs", "summary.json"]
    assert sorted(path.name for path in tmp_path.iterdir()) == files
    legend = json.loads((tmp_path / "columns.json").read_text())["tables"]["episodes.csv"]
    assert list(legend) == list(results.rows.columns)


def test_the_summary_has_groups_pairs_undisturbed_pairs_and_provenance(tmp_path):
    summary = json.loads((_run(fake_plan(seeds=4), tmp_path).folder / "summary.json").read_text())
    assert summary["schema"] == 1
    assert len(summary["groups"]) == 2 * 3
    assert len(summary["paired"]) == 3
    assert len(summary["twins"]) == 2 * 2
    assert summary["provenance"]["seeds"] == [0, 1, 2, 3]
    assert {"versions", "command", "platform", "git"} <= set(summary["provenance"])
    assert len(summary["episodes"]) == 24
    assert list(summary["episodes"][0]) == list(COLUMNS)
    assert summary["episodes"][0]["contact_disturbed"] is None


def test_the_same_command_does_nothing_twice(tmp_path):
    plan = fake_plan(seeds=2)
    before = _run(plan, tmp_path).rows
    files = {path: path.stat().st_mtime_ns for path in (tmp_path / "runs").iterdir()}
    pd.testing.assert_frame_equal(_run(plan, tmp_path, make=None).rows, before)
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "runs").iterdir()} == files


def test_what_is_added_later_gives_the_rows_of_all_at_once(tmp_path):
    plan = fake_plan(seeds=4)
    _run(replace(plan, seeds=(0, 1), policies=plan.policies[:1], cases=plan.cases[:1]), tmp_path / "parts")
    _run(replace(plan, cases=plan.cases[:1]), tmp_path / "parts")
    parts = _run(plan, tmp_path / "parts").rows
    pd.testing.assert_frame_equal(parts, _run(plan, tmp_path / "once").rows)
    asked = json.loads((tmp_path / "parts" / "config.json").read_text())
    assert asked["seeds"] == [0, 1, 2, 3]
    assert len(asked["invocations"]) == 3


def test_less_than_before_leaves_what_is_there(tmp_path):
    plan = fake_plan(seeds=3)
    before = _run(plan, tmp_path).rows
    pd.testing.assert_frame_equal(_run(replace(plan, seeds=(1,)), tmp_path).rows, before)


def _other_case(plan: EvaluationPlan) -> EvaluationPlan:
    case = DisturbanceCase(name="push", schedule=(ScheduledDisturbance(disturbance=DISTURBANCES["pull"], repeats=2),))
    return replace(plan, cases=(case, *plan.cases[1:]))


def _other_policy(plan: EvaluationPlan) -> EvaluationPlan:
    return replace(plan, policies=(PolicySpec(label="hold", builtin="random"),))


def _other_start(plan: EvaluationPlan) -> EvaluationPlan:
    return replace(plan, robots=("pickers",), start="crumpled")


@pytest.mark.parametrize(
    ("change", "words"),
    [(_other_case, "disturbance push"), (_other_policy, "policy hanger hold"), (_other_start, "start is hanging")],
)
def test_another_thing_under_the_same_name_is_refused_and_force_starts_again(tmp_path, change, words):
    plan = fake_plan(seeds=1)
    before = _run(plan, tmp_path).rows
    with pytest.raises(UsageError, match=f"{words}.*give another --out, or --force"):
        _run(change(plan), tmp_path)
    pd.testing.assert_frame_equal(EvaluationResults.open(tmp_path).rows, before)
    assert len(_run(change(plan), tmp_path, force=True).rows) == change(plan).n_episodes


def test_a_model_is_known_by_its_numbers_not_by_its_file(tmp_path):
    from layflat.app.benchmarks.measure import random_model

    model = random_model("hanger", 20)
    save(model, tmp_path / "m.npz")

    def plan(of) -> EvaluationPlan:
        policies = (PolicySpec(label="gp", model=of),)
        return EvaluationPlan(policies=policies, robots=("hanger",), cloths=("towel",), seeds=(0,))

    _run(plan(model), tmp_path / "out")
    _run(plan(load(tmp_path / "m.npz")), tmp_path / "out")
    with pytest.raises(UsageError, match="policy hanger gp is another one"):
        _run(plan(replace(model, alpha=model.alpha * 1.0001)), tmp_path / "out")


@pytest.mark.parametrize("name", ["episodes.csv", "config.json"])
def test_a_folder_with_other_results_is_left_alone(tmp_path, name):
    (tmp_path / name).write_text("policy,seed\nhold,0\n")
    with pytest.raises(UsageError, match="choose another --out"):
        _run(fake_plan(seeds=1), tmp_path)
    assert (tmp_path / name).read_text() == "policy,seed\nhold,0\n"
    assert sorted(path.name for path in tmp_path.iterdir()) in ([name], [name, "runs"])


@pytest.mark.parametrize(
    "tear",
    [
        lambda b: b[:-7],
        lambda b: b + b"hold,hang",
        lambda b: b + b"\0" * 500,
        lambda b: b[: len(b) // 2],
        lambda b: b"",
    ],
)
def test_a_torn_table_is_healed_from_the_episodes(tmp_path, tear):
    plan = fake_plan(seeds=2)
    before = _run(plan, tmp_path).rows
    table = tmp_path / "episodes.csv"
    table.write_bytes(tear(table.read_bytes()))
    (tmp_path / "runs" / "half.h5.part").write_bytes(b"half")
    pd.testing.assert_frame_equal(_run(plan, tmp_path, make=None).rows, before)
    assert not list((tmp_path / "runs").glob("*.part"))


def test_an_episode_that_is_spoilt_and_has_no_row_is_made_again(tmp_path):
    plan = fake_plan(seeds=1)
    before = _run(plan, tmp_path).rows
    (tmp_path / "episodes.csv").unlink()
    run = before["run"][1]
    (tmp_path / "runs" / f"{run}.h5").write_bytes(b"\x89HDF nonsense")
    pd.testing.assert_frame_equal(_run(plan, tmp_path).rows, before)
    assert len(open_session(tmp_path / "runs" / f"{run}.h5")) == 1


def test_one_writer_at_a_time(tmp_path):
    with WriterLock(tmp_path / ".running", tmp_path), pytest.raises(DataError, match="is being written by another"):
        _run(fake_plan(seeds=1), tmp_path)


def test_a_full_disk_ends_the_evaluation_in_one_sentence_and_loses_nothing(tmp_path):
    plan = fake_plan(seeds=3)
    item = list(plan.items())[2]
    full = FakeEpisodes({(key_of(item), "push"): ("disk",)}, marks=tmp_path)
    with pytest.raises(LayflatError, match=r"takes no more files: File too large.*continues from there") as caught:
        _run(plan, tmp_path, make=full, workers=1)
    assert caught.value.exit_status == 1
    rows = EvaluationResults.open(tmp_path).rows
    assert list(rows["run"]) == [*_wanted(plan)[:6], item.run_ids[0], item.run_ids[2]]
    assert not rows["crashed"].any()
    pd.testing.assert_frame_equal(_run(plan, tmp_path).rows, _run(plan, tmp_path / "whole").rows)


def test_no_room_for_the_table_itself(tmp_path, monkeypatch):
    plan = fake_plan(seeds=3)
    monkeypatch.setattr(results_csv.os, "fsync", _full_at_the_fourth())
    with pytest.raises(LayflatError, match=r"takes no more files: No space left.*continues from there"):
        _run(plan, tmp_path)
    monkeypatch.undo()
    assert (tmp_path / "episodes.csv").read_bytes().endswith(b"\n")
    pd.testing.assert_frame_equal(_run(plan, tmp_path).rows, _run(plan, tmp_path / "whole").rows)


def _full_at_the_fourth():
    before, calls = os.fsync, iter(range(1000))

    def fsync(descriptor: int) -> None:
        # Of this process only: the episodes' own have room.
        if os.getpid() == here and next(calls) >= 4:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        before(descriptor)

    here = os.getpid()
    return fsync


def test_a_crash_costs_one_row_after_two_attempts(tmp_path):
    plan = fake_plan(seeds=2)
    first, second, third, _ = plan.items()
    make = FakeEpisodes(
        {
            (key_of(first), "push"): ("segfault", "kill"),
            (key_of(second), "none"): ("exception",),
            (key_of(third), PLACING): ("exit", "exception"),
        }
    )
    rows = _run(plan, tmp_path, make=make).rows.set_index("run")
    crashed = rows[rows["crashed"]]
    assert set(crashed.index) == {first.run_ids[1], first.run_ids[2], *third.run_ids} - {first.run_ids[2]}
    assert "SIGKILL" in crashed.loc[first.run_ids[1], "reason"]
    assert 'the solver has lost its way, and "says" so' in crashed.loc[third.run_ids[0], "reason"]
    assert set(crashed["stopped_by"]) == {"crashed"}
    assert crashed["contact_final"].isna().all()
    assert rows.loc[second.run_ids[0], "attempts"] == 2
    assert rows.loc[[first.run_ids[0], first.run_ids[2]], "attempts"].tolist() == [1, 1]
    summary = EvaluationResults.open(tmp_path).summary
    assert summary["crashed"] == 4
    assert summary["tried_again"] == 5
    with pytest.raises(DataError, match="does not exist"):
        EvaluationResults.open(tmp_path).episode(first.run_ids[1])


def test_what_hangs_is_ended_in_time(tmp_path):
    plan = fake_plan(seeds=1, limit_s=1.0)
    first, second = plan.items()
    make = FakeEpisodes({(key_of(first), "push"): ("hang", "hang"), (key_of(second), PLACING): ("hang",)})
    rows = _run(plan, tmp_path, make=make).rows.set_index("run")
    assert rows.index[rows["crashed"]].tolist() == [first.run_ids[1]]
    assert rows.loc[first.run_ids[1], "reason"] == "took more than 1 s"


def test_results_of_nothing_are_refused(tmp_path):
    with pytest.raises(DataError, match="does not hold the results"):
        EvaluationResults.open(tmp_path)


def test_a_program_that_has_used_opencvs_threads_may_run_evaluations(tmp_path):
    """Its forks have no such threads, and must not wait for them."""
    cv2.setNumThreads(4)
    picture = np.random.default_rng(0).random((800, 800), dtype=np.float32)
    for _ in range(3):
        cv2.resize(cv2.filter2D(picture, -1, np.ones((11, 11), np.float32)), (2000, 2000))
    rows = _run(fake_plan(seeds=2, limit_s=20.0), tmp_path, make=OpencvEpisodes()).rows
    assert not rows["crashed"].any()
    assert (rows["attempts"] == 1).all()
