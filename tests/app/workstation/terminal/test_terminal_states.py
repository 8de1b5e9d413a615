"""What terminals go through: Ctrl-Z and fg, a new size, Ctrl-S, Ctrl-\\, a display that is gone, being dumb."""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import signal
import struct
import tempfile
import termios
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from layflat.data.session.reader import open_session
from layflat.tests.app.workstation.pty_terminal import PROGRAM, Terminal

KEYBOARD = ("--source", "keyboard", "--robot", "pickers", "--cloth", "napkin")


@pytest.fixture
def terminal() -> Iterator[Callable[..., Terminal]]:
    made: list[Terminal] = []

    def start(*arguments: object, **options) -> Terminal:
        made.append(Terminal(*arguments, **options))
        return made[-1]

    yield start
    for each in made:
        each.close()


def local_modes(one: Terminal) -> int:
    """Return whether the terminal echoes and waits for Enter."""
    return termios.tcgetattr(one._theirs)[3] & (termios.ECHO | termios.ICANON)


@pytest.mark.skipif(shutil.which("dash") is None, reason="other shells restore the terminal themselves")
def test_it_is_stopped_and_continued(terminal, tmp_path):
    """The shell gets its terminal back; the demonstration waits for a motion before its time goes on."""
    path = tmp_path / "s.h5"
    one = terminal(program=("dash", "-i"), env=os.environ | {"PS1": "shell> ", "ENV": ""})
    one.until("shell> ")
    one.type(" ".join(map(str, (*PROGRAM, "record", path, *KEYBOARD))) + "\n")
    one.begin()
    one.type("\x1a")
    one.until("shell> ")
    assert local_modes(one) == termios.ECHO | termios.ICANON
    one.type("fg\n")
    one.until("move to continue")
    assert local_modes(one) == 0
    one.hold("s", 0.4)
    one.until("RECORDING")
    one.type("n")
    one.until("kept demo_0 failure")
    one.until("shell> ")
    assert local_modes(one) == termios.ECHO | termios.ICANON
    one.type("exit\n")
    one.end()
    with open_session(path) as session:
        assert len(session) == 1


@pytest.fixture
def short_folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="t", dir="/tmp") as name:
        yield Path(name)


def test_its_size_changes_and_keys_that_freeze_or_quit_do_nothing(terminal, tmp_path, short_folder):
    """Ctrl-C at the end leaves no folder of sockets behind."""
    environment = os.environ | {"COLUMNS": "300", "TMPDIR": str(short_folder)}
    one = terminal("record", tmp_path / "s.h5", *KEYBOARD, env=environment)
    one.until(" hangs]")
    for columns, longest in ((30, 29), (1, 0), (0, 79), (200, 199)):
        fcntl.ioctl(one._theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 2, columns, 0, 0))
        os.kill(one.child.pid, signal.SIGWINCH)
        one.until("\x1b[2J")
        time.sleep(0.3)
        before = one._read
        while one._more():
            pass
        shown = re.findall(r"\r([^\r\n\x1b]*)\x1b\[K", one.text[before:])
        assert shown
        assert max(map(len, shown)) <= longest
        assert columns == 1 or shown[-1].startswith("[seed 0 hangs]")
    one.type("\x13\x1c")  # Ctrl-S, Ctrl-\
    one.begin()
    one.type("\x03")
    assert one.end() == 130
    assert one.as_before()
    assert "kept demo_0 partial" in one.text
    assert list(short_folder.iterdir()) == []


@pytest.mark.slow
def test_a_dumb_terminal_gets_plain_lines(terminal, tmp_path):
    one = terminal("record", tmp_path / "s.h5", *KEYBOARD, env=os.environ | {"TERM": "dumb", "LC_ALL": "C"})
    one.until("quit")
    time.sleep(1.0)
    one.type("q")
    assert one.end() == 0
    assert "\x1b" not in one.text


@pytest.mark.parametrize(
    "stale",
    [
        {"DISPLAY": "localhost:10.0"},
        pytest.param({"DISPLAY": ":99"}, marks=pytest.mark.slow),
        pytest.param({"WAYLAND_DISPLAY": "wayland-9"}, marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_a_display_that_is_gone(terminal, tmp_path, stale):
    """As without one, it is recorded in the terminal; where a window was asked for, it fails with what helps."""
    if Path("/tmp/.X11-unix/X99").exists():
        pytest.skip("there is a display :99")
    # Tests that read a gamepad in this process have set the driver.
    words = [
        "env",
        "-u",
        "SDL_VIDEODRIVER",
        *(f"{name}={value}" for name, value in stale.items()),
        *PROGRAM,
        "record",
        tmp_path / "s.h5",
    ]
    one = terminal(*KEYBOARD, program=tuple(map(str, words)))
    one.until(f"layflat: the display {next(iter(stale.values()))} does not answer; recording in this terminal")
    one.until(" hangs]")
    one.type("q")
    assert one.end() == 0
    asked = terminal(*KEYBOARD, "--window", program=tuple(map(str, words)))
    assert asked.end() == 1
    assert "does not answer" in asked.text
    assert "--no-window" in asked.text
