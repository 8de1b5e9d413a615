"""The Data page offers what `layflat data` does, and runs the command of that name."""

from __future__ import annotations

import time

import pytest
import typer

from layflat.app.cli.data import data_cli
from layflat.app.support.errors import UsageError
from layflat.app.workstation.subprocess_command import SubprocessCommand
from layflat.app.workstation.web.folder import Folder
from layflat.app.workstation.web.operations import ANY, arguments_of, choices, default, fields
from layflat.tests.factories import make_episode, write_session

COMMANDS = typer.main.get_command(data_cli).commands
WRITERS = [name for name, command in COMMANDS.items() if any(param.name == "out" for param in command.params)]


def test_the_page_has_every_option_of_layflat_data():
    """Each is a field, a checkbox of all forms, or the session itself."""
    assert {"filter", "merge", "export", "split", "trim", "video", "plot", "import"} <= set(WRITERS)
    for command in COMMANDS.values():
        there = {param.name for param in fields(command)}
        assert {param.name for param in command.params} - there <= {"json", "force", "debug", "help", "path"}


def test_a_field_offers_what_the_option_takes():
    named = {param.name: param for param in fields(COMMANDS["export"])}
    assert choices(COMMANDS["export"], named["form"]) == ["robomimic", "lerobot", "csv", "minari", "rrd"]
    assert choices(COMMANDS["export"], named["outcome"]) == [ANY, "success", "failure", "partial"]
    assert choices(COMMANDS["export"], named["seed"]) is None


def test_a_field_says_where_it_writes():
    out = next(param for param in fields(COMMANDS["filter"]) if param.name == "out")
    assert default(out, "filter", "demos") == "demos-filter.h5"
    assert default(next(param for param in COMMANDS["repair"].params if param.name == "out"), "repair", "demos") == ""


@pytest.mark.parametrize("value", ["../x.h5", "/tmp/x.h5", "--force", "-o"])
@pytest.mark.parametrize("name", WRITERS)
def test_a_command_writes_nowhere_else(tmp_path, name, value):
    with pytest.raises(UsageError):
        arguments_of(COMMANDS[name], Folder(tmp_path), "demos.h5", {"out": value}, force=False)


def test_no_text_becomes_an_option(tmp_path):
    with pytest.raises(UsageError, match="without a leading -"):
        arguments_of(COMMANDS["filter"], Folder(tmp_path), "demos.h5", {"source": "--out=/tmp/x.h5"}, force=False)


@pytest.mark.parametrize("name", ["merge", "export"])
def test_a_second_session_is_one_of_the_folder(tmp_path, name):
    with pytest.raises(UsageError, match="is not in"):
        arguments_of(
            COMMANDS[name], Folder(tmp_path), "demos.h5", {"paths": "../secret.h5", "out": "both.h5"}, force=False
        )


def test_checkboxes_and_several_values(tmp_path):
    found = arguments_of(
        COMMANDS["export"], Folder(tmp_path), "a.h5",
        {"form": "lerobot", "images": False, "depth": True, "trim_idle": False, "out": "set", "task_text": "lay, fold"},
        force=True,
    )  # fmt: skip
    assert found == [
        "data", "export", str(tmp_path / "a.h5"), "--out", str(tmp_path / "set"), "--format", "lerobot", "--no-images",
        "--depth", "--task-text", "lay", "--task-text", "fold", "--force",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("operation", "values", "made"),
    [
        ("validate", {}, None),
        ("merge", {"paths": "more.h5", "out": "both.h5"}, "both.h5"),
        ("filter", {"outcome": "success", "out": "good.h5"}, "good.h5"),
        ("split", {"out": "parts", "share": "a=0.5, b=0.5"}, "parts/a.h5"),
    ],
)
def test_a_choice_on_the_page_is_the_command_of_that_name(tmp_path, operation, values, made):
    write_session(tmp_path / "demos.h5", [make_episode(seed=seed, n_steps=4) for seed in range(2)])
    write_session(tmp_path / "more.h5", [make_episode(seed=5, n_steps=4)])
    command = SubprocessCommand(arguments_of(COMMANDS[operation], Folder(tmp_path), "demos.h5", values, force=False))
    give_up = time.monotonic() + 90
    while command.running:
        assert time.monotonic() < give_up, list(command.lines)
        time.sleep(0.02)
    assert command.status == 0, list(command.lines)
    assert made is None or (tmp_path / made).exists()
