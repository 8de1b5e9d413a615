"""Recording again continues, copies are said, and so is an evaluation on what was taught; without physics."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from layflat.app.benchmarks.measure import random_model
from layflat.app.cli import main
from layflat.app.commands.place import PlaceConfig, place
from layflat.app.commands.record import record
from layflat.app.evaluation.plan import EvaluationPlan
from layflat.app.evaluation.results import EvaluationResults
from layflat.app.evaluation.run import run_evaluation
from layflat.app.report.evaluation_page import write_evaluation
from layflat.app.workers.record_config import RecordConfig
from layflat.data import open_session
from layflat.policy import model_io
from layflat.policy.spec import PolicySpec
from layflat.tests.app.fake_episodes import FakeEpisodes
from layflat.tests.factories import make_episode, write_session


def recorded(path: Path, episodes: int, seed: int | None = None) -> None:
    record(RecordConfig(path=path, episodes=episodes, seed=seed), force=False, workers=1, make=FakeEpisodes())


def seeds_in(path: Path) -> list[int]:
    with open_session(path) as session:
        return [info.seed for info in session.infos().values()]


@pytest.mark.parametrize(
    ("held", "seed", "new", "said"),
    [
        ([], None, [0, 1], ""),
        ([], 40, [40, 41], ""),
        ([0, 1, 2], None, [3, 4], "has seeds 0 to 2 already; this records seeds 3, 4"),
        ([0, 1, 2], 1, [3, 4], "has seeds 1, 2 already; this records seeds 3, 4"),
        ([0, 2], 0, [1, 3], "has seeds 0, 2 already; this records seeds 1, 3"),
        ([100, 101], None, [102, 103], "has seeds 100, 101 already"),
        ([100, 101], 0, [0, 1], ""),
    ],
)
def test_record_continues_with_the_seeds_that_the_session_does_not_hold(held, seed, new, said, tmp_path, capsys):
    path = tmp_path / "s.h5"
    if held:
        write_session(path, [make_episode(seed=each, descriptor="word-axial") for each in held])
    recorded(path, 2, seed)
    assert seeds_in(path) == [*held, *new]
    err = capsys.readouterr().err
    assert said in err
    assert ("already" in err) == bool(said)


def test_an_interrupted_seed_is_recorded_again(tmp_path):
    outcomes = {0: "success", 1: "partial", 2: "failure"}
    made = [make_episode(seed=seed, outcome=outcome, descriptor="word-axial") for seed, outcome in outcomes.items()]
    recorded(write_session(tmp_path / "s.h5", made), 2)
    assert seeds_in(tmp_path / "s.h5") == [0, 1, 2, 1, 3]


def test_an_episode_that_is_there_by_content_is_kept_and_said(tmp_path, capsys):
    recorded(tmp_path / "a.h5", 1, 7)
    with open_session(tmp_path / "a.h5") as session:
        imported = replace(session[0], seed=-1, source="imported")
    path = write_session(tmp_path / "b.h5", [imported])
    capsys.readouterr()
    recorded(path, 2, 7)
    out, err = capsys.readouterr()
    assert out.count("kept ") == 2
    assert "demo_1 is a copy of demo_0" in err
    assert "demo_2 is a copy" not in err


@pytest.fixture
def run(capsys):
    def call(*arguments: object) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as stop:
            main.main([str(word) for word in arguments])
        return int(stop.value.code or 0), *capsys.readouterr()

    return call


def test_the_data_commands_name_copies(run, tmp_path):
    made = [make_episode(seed=seed, n_steps=12) for seed in range(3)]
    path = write_session(tmp_path / "s.h5", [*made, replace(made[1], outcome="failure"), made[2]])
    named = "2 episodes are copies: demo_3 of demo_1, demo_4 of demo_2"
    status, out, _ = run("data", "info", path, "--json", tmp_path / "info.json")
    assert status == 0
    assert named in out
    copies = {"demo_3": "demo_1", "demo_4": "demo_2"}
    assert json.loads((tmp_path / "info.json").read_text())["copies"] == copies
    status, out, err = run("data", "validate", path, "--json", tmp_path / "valid.json")
    assert (status, out) == (0, f"valid {path}\n")
    assert named in err
    assert json.loads((tmp_path / "valid.json").read_text())["copies"] == copies
    status, out, err = run("data", "merge", path, "--out", tmp_path / "once.h5")
    assert "wrote 3 episodes" in out
    assert f"demo_3 (failure) of {path} is demo_1 (success), demo_4 of {path} is demo_2" in err
    status, _, err = run("data", "export", path, "--out", tmp_path / "rm.h5")
    assert named in err
    status, _, err = run("data", "import", tmp_path / "rm.h5", "--out", tmp_path / "back.h5")
    assert named in err
    status, out, err = run("train", path, tmp_path / "m.npz", "--policy", "nearest")
    assert "3 demonstrations" in out
    assert "one episode is a copy: demo_4 of demo_2; each counts once" in err
    assert run("train", tmp_path / "once.h5", tmp_path / "n.npz", "--policy", "nearest")[2].count("copy") == 0


TAUGHT = replace(random_model("hanger", 20), taught=(("hanging", 3), ("hanging", 4), ("swinging", 6)))


def test_place_says_which_starts_were_taught(tmp_path, capsys):
    model_io.save(TAUGHT, tmp_path / "m.npz")
    for first, seeds in ((2, [3, 4]), (5, []), (PlaceConfig(policy="hold").seed, [])):
        config = PlaceConfig(policy=str(tmp_path / "m.npz"), episodes=3, seed=first, json=tmp_path / "rows.json")
        place(config, workers=1, force=True, make=FakeEpisodes())
        assert json.loads((tmp_path / "rows.json").read_text())["taught"] == seeds
        assert ("was taught on seeds 3, 4 and knows" in capsys.readouterr().err) == bool(seeds)


def test_another_cloth_or_start_was_not_taught(tmp_path):
    spec = PolicySpec(model=TAUGHT)
    plan = {"policies": (spec,), "robots": ("hanger",), "seeds": (3, 6)}
    assert EvaluationPlan(**plan, cloths=("towel",)).taught[0]["seeds"] == [3]
    assert EvaluationPlan(**plan, cloths=("towel",), start="swinging").taught[0]["seeds"] == [6]
    assert EvaluationPlan(**plan, cloths=("napkin",)).taught == ()
    unknown = PolicySpec(model=replace(TAUGHT, taught=(("", 6),)))
    assert EvaluationPlan(**plan | {"policies": (unknown,)}, cloths=("towel",)).taught[0]["seeds"] == [6]


def test_the_summary_and_the_page_say_which_starts_were_taught(tmp_path):
    policies = (PolicySpec(model=TAUGHT), PolicySpec(builtin="hold"))
    for seeds in ((2, 3), (4, 5)):
        plan = EvaluationPlan(policies=policies, robots=("hanger",), cloths=("towel",), seeds=seeds)
        run_evaluation(plan, tmp_path, make=FakeEpisodes())
    results = EvaluationResults.open(tmp_path)
    (entry,) = results.summary["taught"]
    assert entry == {"policy": TAUGHT.policy, "robot": "hanger", "cloth": "towel", "seeds": [3, 4]}
    page = write_evaluation(results).read_text()
    assert f"{TAUGHT.policy} was taught on seeds 3, 4" in page


@pytest.mark.slow
def test_two_people_who_record_the_default_seeds_have_one_demonstration(run, tmp_path):
    sessions = [tmp_path / f"{name}.h5" for name in "ab"]
    for path in sessions:
        assert run("record", path, "--episodes", 1)[0] == 0
    _, out, err = run("data", "merge", *sessions, "--out", tmp_path / "all.h5")
    assert "wrote 1 episodes of 2 sessions" in out
    assert f"demo_0 of {sessions[1]} is demo_0" in err
    assert "needs 2 demonstrations" in run("train", tmp_path / "all.h5", tmp_path / "m.npz")[1]
    _, out, err = run("record", sessions[0], "--episodes", 1)
    assert "kept demo_1" in out
    assert "a.h5 has seed 0 already; this records seed 1" in err
    with open_session(sessions[0]) as session:
        assert session.copies() == {}
    err = run("place", tmp_path / "m.npz", "--seed", 0)[2]
    assert "was taught on seed 0" in err
