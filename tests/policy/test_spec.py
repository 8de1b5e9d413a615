"""PolicySpec: the policies that a text, a task and a robot give."""

from __future__ import annotations

import pytest

from layflat.data.types import ACTION_LIMIT_M
from layflat.policy.base import PolicyError, max_extra_steps
from layflat.policy.spec import BUILTIN_NAMES, PolicySpec, builtin_names
from layflat.sim.config import SimConfig
from layflat.sim.tasks import TASKS
from layflat.tests.fake_environment import FakeEnvironment
from layflat.tests.policy.factories import gp_model, observe


def make_env(robot="pickers", task="place") -> FakeEnvironment:
    env = FakeEnvironment(SimConfig(robot=robot, task=task))
    env.reset(0)
    return env


@pytest.mark.parametrize(
    ("text", "builtin", "wrappers", "label"),
    [
        ("scripted", "scripted", (), "scripted"),
        ("hold+recovery+steady", "hold", ("recovery", "steady"), "hold+recovery+steady"),
        ("mine=hold", "hold", (), "mine"),
        ("word", "word", (), "word"),
    ],
)
def test_a_text_names_a_policy_and_its_wrappers(text, builtin, wrappers, label):
    spec = PolicySpec.parse(text)
    assert (spec.builtin, spec.wrappers, spec.label, spec.model) == (builtin, wrappers, label, None)
    assert spec.robot is None


@pytest.mark.parametrize("task", TASKS)
def test_every_built_in_policy_of_a_task_can_be_made(task):
    env = make_env(task=task)
    for name in builtin_names(task):
        spec = PolicySpec(builtin=name)
        spec.check_task(task)
        assert spec.make(env).act(env.observe()).action.shape == (env.spec.robot.size,)
    assert {*BUILTIN_NAMES} == {name for each in TASKS for name in builtin_names(each)}


def test_the_scripted_policy_is_the_demonstrator_of_the_task():
    assert PolicySpec(builtin="scripted").make(make_env(task="place")).name == "scripted"
    assert PolicySpec(builtin="scripted").make(make_env(task="smooth")).name == TASKS["smooth"].demonstrator


@pytest.mark.parametrize("rule", [None, "drag-rule"])
def test_a_trained_policy_acts_inside_its_wrappers(rule):
    env = make_env("hanger")
    specs = [PolicySpec(model=gp_model(), builtin=rule, wrappers=wrappers) for wrappers in ((), ("recovery", "steady"))]
    bare, wrapped = (spec.make(env) for spec in specs)
    assert [bare.name, wrapped.name] == [spec.label for spec in specs]
    assert wrapped.name == f"{bare.name}+recovery+steady"
    assert max_extra_steps(wrapped) > max_extra_steps(bare) == 0
    # A low free edge that swings ahead, for which ``steady`` waits; the policy alone does not see it.
    swinging = observe(0.0, 0.4, free_edge_m=[0.05, 0.0, 0.03])
    for policy in (bare, wrapped):
        policy.reset(0)
    assert wrapped.act(swinging).action.tolist() == pytest.approx([0.0, ACTION_LIMIT_M])
    assert bare.act(swinging).action.tolist() != pytest.approx([0.0, ACTION_LIMIT_M])


@pytest.mark.parametrize(("name", "task"), [("hold", "smooth"), ("drag-rule", "smooth"), ("word", "place")])
def test_a_policy_of_another_task_is_refused(name, task):
    with pytest.raises(PolicyError, match=f"policy '{name}' is not one of task {task}; give one of scripted"):
        PolicySpec(builtin=name).check_task(task)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({}, "a model, the name"),
        ({"builtin": "iron"}, "policy 'iron' is unknown.*hold"),
        ({"builtin": "hold", "wrappers": ("luck",)}, "wrapper 'luck' is unknown.*recovery, steady"),
        ({"builtin": "hold", "label": "a--b"}, "cannot be part of a file name"),
    ],
)
def test_a_spec_that_makes_no_sense_is_one_sentence(fields, words):
    with pytest.raises(PolicyError, match=words):
        PolicySpec(**fields)
