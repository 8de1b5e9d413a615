"""Policies of `layflat evaluate`, and the command itself on real physics."""

from __future__ import annotations

import json

import pandas as pd
import pytest

from layflat.app.benchmarks.measure import random_model
from layflat.app.cli.main import main
from layflat.app.evaluation.plan import EvaluationPlan, plan_policies
from layflat.app.evaluation.run import run_evaluation
from layflat.app.evaluation.suites import cases_of
from layflat.app.support.errors import UsageError
from layflat.app.support.metrics import COLUMNS
from layflat.app.workers.work_item import DisturbanceCase
from layflat.data.types import Episode
from layflat.policy.base import PolicyError
from layflat.policy.model_io import save
from layflat.policy.schedule import ScheduledDisturbance, Trigger
from layflat.policy.spec import PolicySpec
from layflat.sim.disturbances.presets import DISTURBANCES

USUAL = random_model("hanger", 20).policy
"""Label of a model whose label is not given."""


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """Folder with models of both robots, as good as chance: all are named gp-word."""
    folder = tmp_path_factory.mktemp("models")
    for name, robot in (("hanger", "hanger"), ("hanger_2", "hanger"), ("pickers", "pickers")):
        save(random_model(robot, 20), folder / f"{name}.npz")
    return folder


def _described(texts, robots=()) -> tuple[list[tuple], tuple[str, ...]]:
    """Label, whether there is a model, built-in name and wrappers of each policy; and the robots."""
    policies, wanted = plan_policies(texts, robots)
    return [(p.label, p.model is not None, p.builtin, p.wrappers) for p in policies], wanted


def test_a_model_takes_part_with_its_robot_and_a_built_in_policy_with_all(models):
    policies, robots = plan_policies([f"{models}/hanger.npz", f"{models}/pickers.npz", "hold"], [])
    plan = EvaluationPlan(policies=policies, robots=robots, cloths=("towel",), seeds=(0,))
    assert [(robot, policy.stem) for robot, policy in plan.entries] == [
        ("hanger", "hanger"), ("hanger", "hold"), ("pickers", "pickers"), ("pickers", "hold"),
    ]  # fmt: skip


def test_rules_and_wrappers_keep_their_order(models):
    model = f"{models}/hanger.npz"
    texts = [f"{model}+drag-rule", f"{model}+drag-rule+recovery+steady", f"mine={model}+steady", "hold+recovery"]
    assert _described(texts) == (
        [
            (f"{USUAL}+drag-rule", True, "drag-rule", ()),
            (f"{USUAL}+drag-rule+recovery+steady", True, "drag-rule", ("recovery", "steady")),
            ("mine", True, None, ("steady",)),
            ("hold+recovery", False, "hold", ("recovery",)),
        ],
        ("hanger",),
    )


def test_labels_are_given_or_else_made_distinct_by_the_files(models):
    policies, _ = _described([f"{models}/hanger.npz", f"{models}/hanger_2.npz", f"mine={models}/hanger.npz"])
    assert [label for label, *_ in policies] == [f"{USUAL}@hanger", f"{USUAL}@hanger-2", "mine"]


@pytest.mark.parametrize(
    ("given", "robots", "words"),
    [
        (["hold"], [], "give --robot"),
        (["hold"], ["arm"], "robot 'arm' is unknown"),
        (["nope"], ["hanger"], "neither a model"),
        (["nope.npz"], ["hanger"], "does not exist"),
        (["nope.npz+drag-rule"], ["hanger"], "does not exist"),
        (["{}/hanger.npz+iron"], [], "neither a model"),
        (["{}/hanger.npz+recovery+drag-rule"], [], "one rule may follow"),
        (["{}/hanger.npz+hold+drag-rule"], [], "one rule may follow"),
        (["hold+drag-rule"], ["hanger"], "neither a model"),
        (["{}/hanger.npz"], ["pickers"], "trained for robot hanger, not pickers"),
        (["../x={}/hanger.npz"], [], "does not exist"),
        (["a--b={}/hanger.npz"], [], "cannot be part of a file name"),
    ],
)
def test_policies_that_cannot_take_part(models, given, robots, words):
    with pytest.raises((UsageError, PolicyError), match=words):
        plan_policies([text.format(models) for text in given], robots)


def test_no_policy_takes_part_twice(models):
    policies, robots = plan_policies([f"a={models}/hanger.npz", f"a={models}/hanger_2.npz"], [])
    with pytest.raises(UsageError, match="policy hanger a is there twice"):
        EvaluationPlan(policies=policies, robots=robots, cloths=("towel",), seeds=(0,))


def _call(*words: object) -> int:
    with pytest.raises(SystemExit) as stop:
        main([str(word) for word in words])
    return int(stop.value.code or 0)


def test_the_command_leaves_rows_summary_and_report_and_does_nothing_twice(tmp_path, capsys):
    words = ("drag-rule", "--robot", "pickers", "--start", "folded-corner", "--episodes", 1, "--out", tmp_path)
    assert _call("evaluate", *words, "--disturb", "poke", "--workers", 1) == 0
    out, err = capsys.readouterr()
    assert all(word in out for word in ("drag-rule", "poke", "flat", str(tmp_path)))
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


def test_undisturbed_pairs_are_exact_and_the_same_as_an_episode_of_its_own(tmp_path, differences):
    policies = (PolicySpec(builtin="drag-rule"),)
    usual = {"policies": policies, "robots": ("pickers",), "cloths": ("towel",), "seeds": (3,)}
    usual["start"] = "folded-corner"
    plan = EvaluationPlan(**usual, cases=(*cases_of("poke"), _never()))
    together = run_evaluation(plan, tmp_path / "together", workers=1)
    none, poke, never = (together.episode(run) for run in together.rows["run"])
    assert differences(_placed(none), none.steps) == []
    assert differences(_placed(none), _placed(poke)) == []
    assert len(poke.steps) > len(none.steps)
    # A case that watches from the start, whose moment never comes, is the same placing once more, in another fork.
    assert differences(_placed(none), _placed(never)) == []
    alone = run_evaluation(EvaluationPlan(**usual), tmp_path / "alone", workers=1)
    assert differences(alone.episode(alone.rows["run"][0]).steps, none.steps) == []
    assert sum(abs(step.force_n).sum() for step in poke.steps) > 0
    assert sum(abs(step.force_n).sum() for step in none.steps) == 0


def _never() -> DisturbanceCase:
    """Waits from the start on for a contact that a cloth with a corner folded over does not come to."""
    return DisturbanceCase(
        name="never",
        schedule=(ScheduledDisturbance(disturbance=DISTURBANCES["push"], trigger=Trigger(kind="contact", value=1.0)),),
    )
