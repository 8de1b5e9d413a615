"""`layflat record` by hand, in a real terminal with the real simulation; what it says where something is missing."""

from __future__ import annotations

import fcntl
import os
import pty
import select
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from layflat.app.cli import main
from layflat.app.commands.replay import replay
from layflat.data.session.reader import open_session
from layflat.data.session.recorder import SessionRecorder

PATIENCE_S = 60.0


class Terminal:
    """A pseudo-terminal with the program in it."""

    def __init__(self, *arguments: object) -> None:
        self._mine, theirs = pty.openpty()
        self.before = termios.tcgetattr(theirs)
        self._theirs = theirs
        self.text = ""
        self._read = 0
        environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
        self.child = subprocess.Popen(
            [sys.executable, "-m", "layflat.app.cli.main", *map(str, arguments)],
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            env=environment,
            start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),  # So that Ctrl-C typed there interrupts.
        )

    def type(self, keys: str) -> None:
        os.write(self._mine, keys.encode())

    def hold(self, key: str, seconds: float) -> None:
        """As a terminal repeats it."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.type(key)
            time.sleep(0.04)

    def until(self, words: str) -> str:
        """All that is shown up to these words, from where the last call ended."""
        end = time.monotonic() + PATIENCE_S
        while words not in self.text[self._read :]:
            if time.monotonic() > end or (self.child.poll() is not None and not self._more()):
                raise AssertionError(f"it never showed {words!r} after {self.text[self._read :]!r}")
            self._more()
        found = self.text.index(words, self._read) + len(words)
        shown, self._read = self.text[self._read : found], found
        return shown

    def _more(self) -> bool:
        if not select.select([self._mine], [], [], 0.05)[0]:
            return False
        try:
            text = os.read(self._mine, 65536)
        except OSError:  # Linux: the last program has left the terminal.
            return False
        self.text += text.decode(errors="replace")
        return bool(text)

    def begin(self, key: str = "s") -> None:
        """Through the countdown and a few steps."""
        self.until(" hangs]")
        self.type("\r")
        self.until("move to begin")
        self.hold(key, 0.6)
        self.until("RECORDING")

    def end(self) -> int:
        """The program's status; everything that it showed is in ``text``."""
        end = time.monotonic() + PATIENCE_S
        while self.child.poll() is None and time.monotonic() < end:
            self._more()
        while self._more():
            pass
        return self.child.wait(1.0)

    def as_before(self) -> bool:
        return termios.tcgetattr(self._theirs) == self.before

    def close(self) -> None:
        if self.child.poll() is None:
            self.child.kill()
            self.child.wait()
        os.close(self._mine)
        os.close(self._theirs)


@pytest.fixture
def terminal() -> Iterator[Callable[..., Terminal]]:
    made: list[Terminal] = []

    def start(*arguments: object) -> Terminal:
        made.append(Terminal(*arguments))
        return made[-1]

    yield start
    for each in made:
        each.close()


def left_behind(child: subprocess.Popen) -> list[psutil.Process]:
    """Processes of the program's session that still run a moment after its end."""
    time.sleep(0.5)
    return [p for p in psutil.process_iter() if p.pid != child.pid and _session(p) == child.pid]


def _session(process: psutil.Process) -> int:
    try:
        return -1 if process.status() == psutil.STATUS_ZOMBIE else os.getsid(process.pid)
    except (psutil.NoSuchProcess, ProcessLookupError):
        return -1


def record(path: Path, *more: object) -> tuple[object, ...]:
    return ("record", path, "--source", "keyboard", "--robot", "pickers", "--cloth", "napkin", *more)


def test_one_is_kept_another_discarded_and_the_terminal_is_as_before(terminal, tmp_path):
    path = tmp_path / "s.h5"
    one = terminal(*record(path, "--episodes", 5, "--seed", 3))
    one.begin()
    one.type("y")
    kept = one.until("s.h5").splitlines()[-1].split("\x1b[K")[-1]
    assert kept.startswith("kept demo_0 success ")
    one.begin()
    one.type("x")
    one.until("discarded seed 4 ")
    one.until(" hangs]")
    one.type("q")
    assert one.end() == 0
    assert one.as_before()
    assert "cadence: step " in one.text
    assert "1 demonstration in" in one.text
    assert left_behind(one.child) == []
    with open_session(path) as session:
        (info,) = session.infos().values()
        episode = session[0]
    assert (info.seed, info.source, info.outcome, info.robot) == (3, "keyboard", "success", "pickers")
    assert f"{info.n_steps} steps" in kept
    heights = [step.action[[2, 5]] for step in episode.steps]
    assert heights[0][1] < 0 == heights[0][0]  # Time stood until the key: s lowers the left picker, which is at -y.
    assert [file.name for file in tmp_path.iterdir()] == ["s.h5"]
    replay(path, episode=0, mode="action", json=tmp_path / "r.json", force=False)
    assert '"identical": true' in (tmp_path / "r.json").read_text()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_keeps_what_was_kept_and_what_runs_as_partial(terminal, tmp_path, number):
    path = tmp_path / "s.h5"
    one = terminal(*record(path, "--episodes", 5))
    one.begin()
    if number == signal.SIGINT:
        one.type("\x03")  # Ctrl-C, which reaches every process of the terminal.
    else:
        one.child.send_signal(number)
    assert one.end() == 130
    assert one.as_before()
    assert "kept demo_0 partial " in one.text
    assert "Traceback" not in one.text
    assert left_behind(one.child) == []
    with open_session(path) as session:
        (info,) = session.infos().values()
    assert (info.outcome, info.stopped_by) == ("partial", "interrupted")
    assert [file.name for file in tmp_path.iterdir()] == ["s.h5"]


def test_a_session_of_another_robot_is_refused_and_the_terminal_is_as_before(terminal, tmp_path, make_episode):
    path = tmp_path / "s.h5"
    with SessionRecorder(path, robot="hanger", cloth="napkin") as recorder:
        recorder.save(make_episode(cloth="napkin", disturbed=False))
    one = terminal(*record(path))
    assert one.end() == 2
    assert one.as_before()
    assert "has robot hanger, not pickers" in one.text
    assert "Traceback" not in one.text


@pytest.mark.slow
def test_killed_in_the_middle_the_next_recording_tells_what_was_left(terminal, tmp_path):
    path = tmp_path / "s.h5"
    one = terminal(*record(path))
    one.begin()
    time.sleep(1.0)  # The journal is flushed twice a second.
    one.child.kill()
    one.child.wait()
    assert left_behind(one.child) == []
    two = terminal(*record(path))
    two.until("kept demo_0 partial ")
    two.until(" hangs]")
    two.type("q")
    assert two.end() == 0
    with open_session(path) as session:
        assert [info.stopped_by for info in session.infos().values()] == ["crashed"]


@pytest.mark.slow
def test_a_crash_of_the_simulation_costs_one_take(terminal, tmp_path):
    one = terminal(*record(tmp_path / "s.h5"))
    one.begin()
    for process in psutil.Process(one.child.pid).children(recursive=True):
        # Takes are the fork server's children.
        if process.ppid() != one.child.pid and process.status() != psutil.STATUS_ZOMBIE:
            process.send_signal(signal.SIGSEGV)
    one.until("kept demo_0 partial ")
    one.begin()
    one.type("y")
    one.until("kept demo_1 success ")
    assert one.end() == 0
    with open_session(tmp_path / "s.h5") as session:
        assert [info.seed for info in session.infos().values()] == [0, 0]


def _call(capsys, *arguments: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as stop:
        main.main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    return int(stop.value.code or 0), out, err


@pytest.fixture
def bare(monkeypatch, tmp_path) -> Path:
    """Neither display nor terminal nor pad."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    (tmp_path / "work").mkdir()
    return tmp_path / "work"


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("mouse", ("no display", "keyboard", "gamepad")),
        ("kinesthetic", ("no display", "keyboard", "gamepad")),
        ("gamepad", ("no gamepad is plugged in", "--source keyboard")),
        ("keyboard", ("terminal", "--source gamepad or scripted")),
    ],
)
def test_what_is_missing_is_said_with_what_works_instead(bare, capsys, source, words):
    status, out, err = _call(capsys, "record", bare / "s.h5", "--source", source)
    assert (status, out) == (1, "")
    assert err.count("\n") == 1
    assert all(word in err for word in words)
    assert not list(bare.iterdir())


def test_no_window_is_no_window_even_where_there_is_a_display(bare, capsys, monkeypatch):
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.delenv("SDL_VIDEODRIVER", raising=False)
    status, out, err = _call(capsys, "record", bare / "s.h5", "--source", "mouse", "--no-window")
    assert (status, out) == (1, "")
    assert "--no-window leaves none" in err
    status, out, err = _call(capsys, "record", bare / "s.h5", "--source", "keyboard", "--no-window")
    assert (status, out) == (1, "")
    assert "terminal" in err


@pytest.mark.parametrize(
    "arguments",
    [
        ("--pad", "none.json"),
        ("--disturb", "hurricane"),
        ("--cloth", "silk"),
        ("--descriptor", "sift"),
        ("--force",),
        ("--episodes", "0"),
    ],
    ids=" ".join,
)
def test_wrong_calls_come_before_anything_is_opened(bare, capsys, arguments):
    (bare / "s.h5").touch()
    status, out, err = _call(capsys, "record", bare / "s.h5", "--source", "keyboard", *arguments)
    assert (status, out) == (2, "")
    assert err.count("\n") == 1
    assert (bare / "s.h5").read_bytes() == b""
