"""The Data page offers what `layflat data` does, and runs the command of that name."""

from __future__ import annotations

import time

import pytest
import typer

from layflat.app.cli.data import data_cli
from layflat.app.workstation.subprocess_command import SubprocessCommand
from layflat.app.workstation.web.folder import Folder
from layflat.app.workstation.web.operations import OPERATIONS, arguments_of
from layflat.tests.factories import make_episode, write_session

GENERAL = {"--json", "--force", "--debug", "--help"}
"""Options that the page does not need, or has a checkbox for."""
ELSEWHERE = {"edit"}
"""Commands that have parts of their own on the page."""


def test_the_page_has_every_command_of_layflat_data():
    commands = typer.main.get_command(data_cli).commands
    assert set(OPERATIONS) == set(commands) - ELSEWHERE
    for name, fields in OPERATIONS.items():
        parameters = commands[name].params
        known = {option for one in parameters for option in (*one.opts, *one.secondary_opts) if option.startswith("--")}
        here = {item.option for item in fields if item.option}
        assert here <= known, name
        if name in ("video", "trim", "split", "filter", "merge", "repair", "import"):
            assert known - here <= GENERAL, name


@pytest.mark.parametrize(
    ("operation", "values", "made"),
    [
        ("validate", {}, None),
        ("filter", {"outcome": "success", "out": "good.h5"}, "good.h5"),
        ("split", {"out": "parts", "share": "a=0.5 b=0.5"}, "parts/a.h5"),
    ],
)
def test_a_choice_on_the_page_is_the_command_of_that_name(tmp_path, operation, values, made):
    write_session(tmp_path / "demos.h5", [make_episode(seed=seed, n_steps=4) for seed in range(2)])
    command = SubprocessCommand(arguments_of(operation, Folder(tmp_path), "demos.h5", values, force=False))
    give_up = time.monotonic() + 90
    while command.running:
        assert time.monotonic() < give_up, list(command.lines)
        time.sleep(0.02)
    assert command.status == 0, list(command.lines)
    assert made is None or (tmp_path / made).exists()
