"""What the viewers share: settings in the folder, commands in the background."""

from __future__ import annotations

import json
import time

import pytest

from layflat.app.workstation import settings
from layflat.app.workstation.settings import Settings
from layflat.app.workstation.subprocess_command import SubprocessCommand


def ended(command: SubprocessCommand, seconds: float = 90.0) -> SubprocessCommand:
    give_up = time.monotonic() + seconds
    while command.status is None:
        assert time.monotonic() < give_up, list(command.lines)
        time.sleep(0.02)
    return command


def test_a_command_that_fails_says_why(tmp_path):
    command = ended(SubprocessCommand(["data", "info", str(tmp_path / "none.h5")]))
    assert (command.status, command.outcome()) == (2, "failed, exit status 2")
    assert "none.h5" in command.lines[-1]


def test_a_cancelled_command_ends_at_once(tmp_path):
    command = SubprocessCommand(
        ["record", str(tmp_path / "more.h5"), "--robot", "pickers", "--episodes", "50", "--workers", "1"]
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
