"""Who takes part in `layflat evaluate`, and the command itself on the real bench."""

from __future__ import annotations

import json

import pandas as pd
import pytest

from layflat.app.benchmarks.measure import random_model
from layflat.app.cli.main import main
from layflat.app.commands.evaluate import entrants_of
from layflat.app.evaluation.plan import DisturbanceCase, EvaluationPlan, PolicySpec
from layflat.app.evaluation.run import run_batch
from layflat.app.evaluation.suites import cases_of
from layflat.app.support.errors import UsageError
from layflat.app.support.metrics import COLUMNS
from layflat.data.types import Episode
from layflat.policy.model_io import save
from layflat.policy.schedule import ScheduledDisturbance, Trigger
from layflat.sim.disturbances.presets import DISTURBANCES


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """Folder with models of both robots, as good as chance: all are named gp-word."""
    folder = tmp_path_factory.mktemp("models")
    for name, robot in (("hanger", "hanger"), ("hanger_2", "hanger"), ("pickers", "pickers")):
        save(random_model(robot, 20), folder / f"{name}.npz")
    return folder


def _who(entrants) -> list[tuple]:
    return [(e.robot, e.name, e.model is not None, e.made) for e in entrants]


def test_a_model_takes_part_in_its_robot_and_a_rule_in_all(models):
    name = random_model("hanger", 20).policy
    found = entrants_of([f"{models}/hanger.npz", f"{models}/pickers.npz", "hold"], [])
    assert _who(found) == [
        ("hanger", name, True, None),
        ("hanger", "hold", False, "hold"),
        ("pickers", name, True, None),
        ("pickers", "hold", False, "hold"),
    ]


def test_a_rule_may_repair_what_a_model_has_placed(models):
    (found,) = entrants_of([f"{models}/hanger.npz+drag-rule"], [])
    assert (found.name, found.made) == (f"{random_model('hanger', 20).policy}+drag-rule", "drag-rule")


def test_what_is_around_a_policy_comes_last_and_keeps_its_order(models):
    usual = random_model("hanger", 20).policy
    (found,) = entrants_of([f"{models}/hanger.npz+drag-rule+recovery+steady"], [])
    assert found.name == f"{usual}+drag-rule+recovery+steady"
    assert (found.made, found.decorators) == ("drag-rule", ("recovery", "steady"))
    (found,) = entrants_of([f"mine={models}/hanger.npz+steady"], [])
    assert (found.name, found.made, found.decorators) == ("mine", None, ("steady",))
    (found,) = entrants_of(["hold+recovery"], ["pickers"])
    assert (found.name, found.model, found.made, found.decorators) == ("hold+recovery", None, "hold", ("recovery",))


def test_names_are_given_or_else_told_apart_by_the_files(models):
    one, two, three = entrants_of([f"{models}/hanger.npz", f"{models}/hanger_2.npz", f"mine={models}/hanger.npz"], [])
    usual = random_model("hanger", 20).policy
    assert [one.name, two.name, three.name] == [f"{usual}@hanger", f"{usual}@hanger-2", "mine"]


@pytest.mark.parametrize(
    ("given", "robots", "words"),
    [
        (["hold"], [], "give --robot"),
        (["hold"], ["arm"], "robot 'arm' is unknown"),
        (["nope"], ["hanger"], "neither a model's file"),
        (["nope.npz"], ["hanger"], "does not exist"),
        (["nope.npz+drag-rule"], ["hanger"], "does not exist"),
        (["{}/hanger.npz+iron"], [], "neither a model's file"),
        (["{}/hanger.npz+recovery+drag-rule"], [], "one rule may come"),
        (["{}/hanger.npz+hold+drag-rule"], [], "one rule may come"),
        (["hold+drag-rule"], ["hanger"], "neither a model's file"),
        (["{}/hanger.npz"], ["pickers"], "was taught another robot"),
        (["../x={}/hanger.npz"], [], "does not exist"),
        (["a--b={}/hanger.npz"], [], "cannot be part of a file's name"),
    ],
)
def test_who_cannot_take_part(models, given, robots, words):
    with pytest.raises(UsageError, match=words):
        entrants_of([text.format(models) for text in given], robots)


def test_nobody_takes_part_twice(models):
    entrants = entrants_of([f"a={models}/hanger.npz", f"a={models}/hanger_2.npz"], [])
    with pytest.raises(UsageError, match="policy hanger a is there twice"):
        EvaluationPlan(entrants=entrants, cloths=("towel",), seeds=(0,))


def _call(*words: object) -> int:
    with pytest.raises(SystemExit) as stop:
        main([str(word) for word in words])
    return int(stop.value.code or 0)


def test_the_command_leaves_rows_summary_and_report_and_does_nothing_twice(tmp_path, capsys):
    words = ("drag-rule", "--robot", "pickers", "--start", "folded-corner", "--episodes", 1, "--out", tmp_path)
    assert _call("evaluate", *words, "--disturb", "poke", "--workers", 1) == 0
    out, err = capsys.readouterr()
    assert all(word in out for word in ("drag-rule", "poke", "success", str(tmp_path)))
    assert "poke" in err
    rows = pd.read_csv(tmp_path / "episodes.csv")
    assert list(rows.columns[: len(COLUMNS)]) == list(COLUMNS)
    assert list(rows["disturbance"]) == ["none", "poke"]
    assert {"groups", "provenance"} <= set(json.loads((tmp_path / "summary.json").read_text()))
    assert (tmp_path / "report.html").exists()
    before = (tmp_path / "episodes.csv").read_bytes()
    assert _call("disturb", *words, "--suite", "poke") == 0
    assert (tmp_path / "episodes.csv").read_bytes() == before


def _placed(episode: Episode) -> Episode:
    first, last = episode.phase_bounds("place")
    assert first == 0
    return episode.steps[:last]


def test_twins_are_exact_and_those_of_an_episode_of_its_own(tmp_path, differences):
    entrants = (PolicySpec(name="rule", robot="pickers", made="drag-rule"),)
    usual = {"entrants": entrants, "cloths": ("towel",), "seeds": (3,), "start": "folded-corner"}
    plan = EvaluationPlan(**usual, cases=(*cases_of("poke"), _never()))
    together = run_batch(plan, tmp_path / "together", workers=1)
    none, poke, never = (together.episode(run) for run in together.rows["run"])
    assert differences(_placed(none), none.steps) == []
    assert differences(_placed(none), _placed(poke)) == []
    assert len(poke.steps) > len(none.steps)
    # A case that watches from the start, whose moment never comes, is the same placing once more, in another fork.
    assert differences(_placed(none), _placed(never)) == []
    alone = run_batch(EvaluationPlan(**usual), tmp_path / "alone", workers=1)
    assert differences(alone.episode(alone.rows["run"][0]).steps, none.steps) == []
    assert sum(abs(step.force_n).sum() for step in poke.steps) > 0
    assert sum(abs(step.force_n).sum() for step in none.steps) == 0


def _never() -> DisturbanceCase:
    """Waits from the start on for a contact that a cloth with a corner folded over does not come to."""
    return DisturbanceCase(
        name="never",
        schedule=(ScheduledDisturbance(disturbance=DISTURBANCES["push"], when=Trigger(kind="contact", value=1.0)),),
    )
