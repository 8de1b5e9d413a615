"""Policies of the user's: found by module and name, by entry point, and checked in every step."""

from __future__ import annotations

import importlib
import sys

import numpy as np
import pytest

from layflat.policy.base import Decision, PolicyError
from layflat.policy.foreign.checked import CheckedPolicy
from layflat.policy.foreign.factory import PolicyFactory
from layflat.policy.rollout import rollout
from layflat.policy.spec import PolicySpec
from layflat.sim.config import SimConfig
from layflat.tests.fake_environment import FakeEnvironment

MODULE = """
import numpy as np
number = 3

class Forward:
    def __init__(self, spec):
        self.size = spec.robot.size
    def reset(self, seed): ...
    def act(self, observation):
        return np.full(self.size, 0.01)

class parts:
    @staticmethod
    def make(spec):
        return Forward(spec)

def broken(spec):
    raise RuntimeError("no weights here")

def none(spec):
    return 3
"""


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The current folder, with a module of the user's, which no other test may find."""
    (tmp_path / "own_policy_7.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    importlib.invalidate_caches()
    yield tmp_path
    sys.modules.pop("own_policy_7", None)


def env(robot="hanger") -> FakeEnvironment:
    made = FakeEnvironment(SimConfig(robot=robot))
    made.reset(0)
    return made


@pytest.mark.parametrize("robot", ["hanger", "pickers"])
@pytest.mark.parametrize("text", ["own_policy_7:Forward", "own_policy_7:parts.make"])
def test_a_factory_gets_the_spec_and_its_policy_acts(text, robot):
    spec = PolicySpec.parse(f"mine={text}")
    episode = rollout(env(robot), spec, seed=3, max_steps=5)
    assert spec.label == "mine"
    assert episode.source == "mine"
    assert [step.action.tolist() for step in episode.steps] == [[0.01] * env(robot).spec.robot.size] * 5


def test_a_factory_takes_a_rule_and_wrappers():
    spec = PolicySpec.parse("own_policy_7:Forward+drag-rule+recovery")
    assert (spec.label, spec.builtin, spec.wrappers) == (
        "own_policy_7.Forward+drag-rule+recovery",
        "drag-rule",
        ("recovery",),
    )
    assert spec.make(env()).name == "own_policy_7.Forward+drag-rule+recovery"


def test_a_factory_is_found_again_in_a_process_that_was_started_elsewhere(folder, monkeypatch, tmp_path_factory):
    factory = PolicySpec.parse("own_policy_7:Forward").foreign
    assert factory.folder == str(folder)
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))
    sys.modules.pop("own_policy_7")
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path not in ("", str(folder))])
    assert factory.make(env().spec, "mine").act(env().observe()).action.tolist() == [0.01, 0.01]


def test_a_folder_cannot_replace_an_installed_module(folder):
    (folder / "json.py").write_text("def dumps(spec): return 3\n")
    assert PolicyFactory.find("json:dumps").folder == ""


def test_an_entry_point_is_a_name(monkeypatch):
    point = importlib.metadata.EntryPoint("my-net", "own_policy_7:Forward", "layflat.policies")
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda group: [point] if group == point.group else [])
    spec = PolicySpec.parse("my-net+recovery")
    assert spec.label == "own_policy_7.Forward+recovery"
    assert spec.foreign.text == "own_policy_7:Forward"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("own_policy_7:nothing", "has no nothing"),
        ("own_policy_7:number", "no class or function, but of type int"),
        ("no_such_module_7:make", "cannot be imported, ModuleNotFoundError"),
        ("own policy:make", "neither a model"),
    ],
)
def test_a_text_that_names_no_factory_is_one_sentence(text, words):
    with pytest.raises(PolicyError, match=words):
        PolicySpec.parse(text)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("own_policy_7:broken", "failed on the environment's spec, RuntimeError: no weights here"),
        ("own_policy_7:none", "is no policy: a int has no method reset"),
    ],
)
def test_a_factory_that_makes_no_policy_is_one_sentence(text, words):
    with pytest.raises(PolicyError, match=words):
        PolicySpec.parse(text).make(env())


class Answers:
    """A policy that answers one thing."""

    def __init__(self, answer) -> None:
        self.answer = answer

    def reset(self, seed): ...

    def act(self, observation):
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        ([0.01, np.nan], r"answered \[0.01, nan\] in step 1; an action has 2 finite numbers \(dx, dz\), in metres"),
        (np.zeros(3), r"an array of shape \(3,\)"),
        (None, "answered"),
        ("left", "answered a str"),
        (Decision(action=np.zeros(6)), r"an action of shape \(6,\)"),
        (KeyError("joint"), "failed in step 1 by KeyError: 'joint'"),
        (PolicyError("out of range"), "mine: out of range"),
    ],
)
def test_a_wrong_answer_is_one_sentence(answer, words):
    policy = CheckedPolicy(Answers(answer), name="mine", robot=env().spec.robot)
    policy.reset(0)
    with pytest.raises(PolicyError, match=words):
        policy.act(env().observe())


def test_a_policy_of_another_robot_is_refused():
    policy = Answers(None)
    policy.robot = env("pickers").spec.robot
    with pytest.raises(PolicyError, match="mine is for robot pickers, not hanger"):
        CheckedPolicy(policy, name="mine", robot=env().spec.robot)
