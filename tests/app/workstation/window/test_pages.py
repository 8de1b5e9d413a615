"""Pages of the window: every command of the data sets, settings, commands in the background."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import typer

from layflat.app.cli.data import data_cli
from layflat.app.workstation import settings
from layflat.app.workstation.settings import Settings
from layflat.app.workstation.subprocess_command import SubprocessCommand
from layflat.app.workstation.window.layout import layout
from layflat.app.workstation.window.pages.data import OPERATIONS, DataPage
from layflat.app.workstation.window.pages.page import WindowContext
from layflat.data.session.reader import open_session
from layflat.data.session.recorder import SessionRecorder
from layflat.tests.factories import HANGER

GENERAL = {"--json", "--force", "--debug", "--help"}
"""Options that the window does not need, or has a switch for."""


@pytest.fixture
def folder(tmp_path: Path, make_episode: Callable) -> Path:
    """With a session of three episodes, one of them a failure."""
    with SessionRecorder(tmp_path / "demos.h5", robot=HANGER, cloth="towel") as recorder:
        for seed, outcome in enumerate(["success", "failure", "success"]):
            recorder.save(make_episode(seed=seed, outcome=outcome))
    return tmp_path


def context_of(folder: Path) -> WindowContext:
    return WindowContext(folder=folder, settings=Settings(), remember=True, client=None, layout=layout((1280, 720)))


def ended(command: SubprocessCommand, seconds: float = 90.0) -> SubprocessCommand:
    give_up = time.monotonic() + seconds
    while command.status is None:
        assert time.monotonic() < give_up, list(command.lines)
        time.sleep(0.02)
    return command


def test_the_page_has_every_command_of_layflat_data():
    commands = typer.main.get_command(data_cli).commands
    assert set(OPERATIONS) == set(commands)
    for name, command in commands.items():
        known = {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
        known = {option for option in known if option.startswith("--")}
        here = {item.option for item in OPERATIONS[name] if item.option}
        assert here <= known, name
        if name in ("video", "trim", "split", "filter", "merge", "repair", "import"):
            assert known - here <= GENERAL, name


@pytest.mark.parametrize(
    ("operation", "values", "made"),
    [
        ("validate", {}, None),
        ("filter", {"outcome": "success", "out": "good.h5"}, "good.h5"),
        ("trim", {"episode": "demo_2", "stop": "3", "out": "short.h5"}, "short.h5"),
        ("split", {"out": "parts", "share": "a=0.5 b=0.5"}, "parts/a.h5"),
        ("plot", {"out": "page.png"}, "page.png"),
    ],
)
def test_a_choice_in_the_menu_is_the_command_of_that_name(folder, operation, values, made):
    page = DataPage(context_of(folder), session="demos.h5", operation=operation, values=values)
    command = ended(SubprocessCommand(page.arguments()))
    assert command.status == 0, list(command.lines)
    assert command.outcome() == "done"
    if made:
        assert (folder / made).exists()
    if operation == "filter":
        with open_session(folder / "good.h5") as session:
            assert len(session) == 2


def test_an_existing_file_is_only_replaced_on_request(folder):
    (folder / "page.png").write_bytes(b"mine")
    page = DataPage(context_of(folder), session="demos.h5", operation="plot", values={"out": "page.png"})
    command = ended(SubprocessCommand(page.arguments()))
    assert (command.status, command.outcome()) == (2, "failed, exit status 2")
    assert "exists" in command.lines[-1]
    page.force = True
    assert ended(SubprocessCommand(page.arguments())).status == 0


def test_a_cancelled_command_ends_at_once(folder):
    command = SubprocessCommand(
        ["record", str(folder / "more.h5"), "--robot", "pickers", "--episodes", "50", "--workers", "1"]
    )
    give_up = time.monotonic() + 30
    while not command.activity and time.monotonic() < give_up:
        time.sleep(0.02)
    command.cancel()
    assert ended(command, 30.0).outcome() == "cancelled"
    command.close()


def test_settings_are_saved(tmp_path):
    wanted = Settings(robot="pickers", cloth="napkin", source="keyboard", speed="double", images=True, countdown_s=1.0)
    settings.save(tmp_path, wanted)
    assert settings.load(tmp_path) == wanted


@pytest.mark.parametrize(
    "text",
    [
        "",
        "no json",
        "[]",
        json.dumps({"robot": "juggling", "noise": "loud", "unknown": 3}),
        json.dumps({"step_s": None}),
    ],
)
def test_invalid_settings_are_the_defaults(tmp_path, text):
    (tmp_path / settings.FILE).write_text(text)
    assert settings.load(tmp_path) == Settings()


def test_a_window_that_does_not_remember_writes_nothing(tmp_path):
    context = replace(context_of(tmp_path), remember=False)
    context.change_settings(Settings(robot="pickers"))
    assert context.settings.robot == "pickers"
    assert not list(tmp_path.iterdir())
