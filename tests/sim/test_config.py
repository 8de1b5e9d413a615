"""Simulation settings: defaults of a task, and what is refused."""

from __future__ import annotations

import pytest

from layflat.sim.config import SimConfig
from layflat.sim.errors import SimError
from layflat.sim.robots.registry import ROBOTS
from layflat.sim.starts.registry import STARTS
from layflat.sim.tasks import TASKS


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [
        ({"robot": "feet"}, "hanger, pickers, dual-arm"),
        ({"cloth": "silk"}, "towel, napkin"),
        ({"physics": "clay"}, "bullet"),
        ({"task": "iron"}, "place, smooth"),
        ({"start": "folded"}, "crumpled"),
        ({"start": "hanging", "task": "smooth"}, "crumpled"),
        ({"start": "crumpled", "robot": "hanger"}, "pickers"),
        ({"task": "smooth", "robot": "hanger"}, "pickers"),
        ({"descriptor": "sift"}, "word-axial"),
        ({"step_s": 0.0}, "between"),
        ({"step_s": 2.0}, "between"),
    ],
)
def test_invalid_settings_are_refused(wrong: dict, hint: str) -> None:
    with pytest.raises(SimError, match=hint):
        SimConfig(**({"robot": "pickers"} | wrong))


@pytest.mark.parametrize("task", TASKS.values(), ids=str)
def test_a_task_begins_with_its_first_start_unless_another_is_named(task) -> None:
    assert SimConfig(robot="pickers", task=task.name).start == task.starts[0]
    for start in task.starts:
        assert SimConfig(robot="pickers", task=task.name, start=start).start_spec is STARTS[start]


@pytest.mark.parametrize("task", TASKS.values(), ids=TASKS)
def test_an_environment_has_the_step_limits_and_the_demonstrator_of_its_task(task) -> None:
    spec = SimConfig(robot="pickers", task=task.name).environment_spec()
    assert (spec.limits, spec.demonstrator) == (task.limits, task.demonstrator)
    assert TASKS["smooth"].limits != TASKS["place"].limits


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_environment_spec_makes_the_same_settings_again(robot: str) -> None:
    config = SimConfig(robot=robot, cloth="napkin", descriptor="how", table_friction=0.9, noise=False, step_s=0.05)
    spec = config.environment_spec()
    own = {"task": spec.task, "physics": spec.physics, "descriptor": spec.descriptor, "step_s": spec.step_s}
    assert SimConfig(robot=spec.robot.name, cloth=spec.cloth, **own, **spec.config) == config
