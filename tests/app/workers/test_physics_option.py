"""`--physics` and `--set physics=`: the same engine wherever a simulation is made, one sentence where it cannot be."""

from __future__ import annotations

import pytest

from layflat.app.commands.replay import rerun
from layflat.app.support.errors import UsageError
from layflat.app.workers.sim_options import parse_conditions, sim_config
from layflat.sim.physics import registry
from layflat.tests.factories import make_episode


def test_the_engine_is_a_condition(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "is_installed", lambda name: True)
    config = sim_config(["physics=mujoco", "table_friction=0.8"], robot="pickers")
    assert (config.physics, config.table_friction) == ("mujoco", 0.8)
    assert config.environment_spec().physics == "mujoco"
    assert parse_conditions(["physics=mujoco", "physics=mujoco"]) == {"physics": "mujoco"}
    assert sim_config(robot="pickers").physics == "bullet"


@pytest.mark.parametrize(
    ("texts", "match"), [(["physics=clay"], "bullet, mujoco"), (["physics=bullet", "physics=mujoco"], "give it once")]
)
def test_wrong_engines_are_one_sentence(texts: list[str], match: str) -> None:
    with pytest.raises(UsageError, match=match):
        sim_config(texts, robot="pickers")


def test_an_engine_that_is_not_installed_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "is_installed", lambda name: name != "mujoco")
    with pytest.raises(UsageError, match=r"not installed: pip install 'layflat\[mujoco\]'"):
        sim_config(["physics=mujoco"], robot="pickers")


def test_actions_are_not_run_in_another_engine() -> None:
    with pytest.raises(UsageError, match="recorded in physics bullet and mean nothing in mujoco"):
        rerun(make_episode(), ["physics=mujoco"])
