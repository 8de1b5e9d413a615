"""`layflat record` by a person in a real terminal, with the real simulation; missing devices and wrong calls."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest

from layflat.app.benchmarks.measure import random_model
from layflat.app.cli import main
from layflat.app.commands.replay import ReplayConfig, replay
from layflat.data.session.reader import open_session
from layflat.data.session.recorder import SessionRecorder
from layflat.data.types import Episode
from layflat.policy import model_io
from layflat.tests.app.workstation.pty_terminal import Terminal
from layflat.tests.factories import HANGER


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
    """Return processes of the program's session that still run a moment after its end."""
    time.sleep(0.5)
    return [p for p in psutil.process_iter() if p.pid != child.pid and _session(p) == child.pid]


def _session(process: psutil.Process) -> int:
    try:
        return -1 if process.status() == psutil.STATUS_ZOMBIE else os.getsid(process.pid)
    except (psutil.NoSuchProcess, ProcessLookupError):
        return -1


def _deep(process: psutil.Process, one: Terminal) -> bool:
    """Return whether a process is not started by the program itself."""
    return process.ppid() != one.child.pid


def record_command(path: Path, *more: object) -> tuple[object, ...]:
    return ("record", path, "--source", "keyboard", "--robot", "pickers", "--cloth", "napkin", *more)


def check_replay(path: Path, folder: Path) -> Episode:
    """The recorded actions give the same bits again."""
    replay(ReplayConfig(path=path, episode=0, mode="action", json=folder / "r.json"), force=False)
    assert '"identical": true' in (folder / "r.json").read_text()
    with open_session(path) as session:
        return session[0]


def test_an_episode_is_kept_another_discarded_and_the_terminal_restored(terminal, tmp_path):
    path = tmp_path / "s.h5"
    one = terminal(*record_command(path, "--episodes", 5, "--seed", 3))
    one.begin()
    one.type("y")
    one.until("keep as success?")
    one.type("y")
    kept = one.until("s.h5").splitlines()[-1].split("\x1b[J")[-1]
    assert kept.startswith("kept demo_0 success ")
    one.begin()
    one.type("x")
    one.until("undo brings it back")
    one.until(" hangs]")
    one.type("q")
    assert one.end() == 0
    assert "discarded seed 4 " in one.text
    assert one.as_before()
    assert "timing: step " in one.text
    assert "1 demonstration in" in one.text
    assert left_behind(one.child) == []
    assert [file.name for file in tmp_path.iterdir()] == ["s.h5"]
    with open_session(path) as session:
        (info,) = session.infos().values()
    assert (info.seed, info.source, info.outcome, str(info.robot)) == (3, "keyboard", "success", "pickers")
    assert f"{info.n_steps} steps" in kept
    # Time waited for the key: s lowers the left picker, which is at -y.
    first = check_replay(path, tmp_path).steps[0].action[[2, 5]]
    assert first[1] < 0 == first[0]


def test_without_a_gamepad_the_keyboard_records(terminal, tmp_path):
    path = tmp_path / "s.h5"
    one = terminal("record", path, "--source", "gamepad", "--robot", "pickers", "--cloth", "napkin")
    one.until("no gamepad is plugged in; the keyboard is used instead")
    one.begin()
    one.type("n")
    one.until("kept demo_0 failure")
    one.type("q")
    assert one.end() == 0
    with open_session(path) as session:
        assert session.info("demo_0").source == "keyboard"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_keeps_saved_episodes_and_a_running_one_as_partial(terminal, tmp_path, number):
    path = tmp_path / "s.h5"
    one = terminal(*record_command(path, "--episodes", 5))
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


def test_a_session_of_another_robot_is_refused_and_the_terminal_restored(terminal, tmp_path, make_episode):
    path = tmp_path / "s.h5"
    with SessionRecorder(path, robot=HANGER, cloth="napkin") as recorder:
        recorder.save(make_episode(cloth="napkin", disturbed=False))
    one = terminal(*record_command(path))
    assert one.end() == 2
    assert one.as_before()
    assert "robot hanger, not pickers" in one.text
    assert "Traceback" not in one.text


@pytest.mark.slow
def test_after_a_kill_of_the_terminal_the_session_saves_its_steps(terminal, tmp_path):
    path = tmp_path / "s.h5"
    one = terminal(*record_command(path))
    one.begin()
    one.child.kill()
    one.child.wait()
    end = time.monotonic() + 20.0
    while left_behind(one.child):
        assert time.monotonic() < end
    with open_session(path) as session:
        assert [(info.outcome, info.stopped_by) for info in session.infos().values()] == [("partial", "interrupted")]
    assert [file.name for file in tmp_path.iterdir()] == ["s.h5"]


@pytest.mark.slow
def test_after_a_kill_of_the_session_the_next_recording_saves_the_steps(terminal, tmp_path):
    path = tmp_path / "s.h5"
    one = terminal(*record_command(path))
    one.begin()
    time.sleep(1.0)  # The journal is flushed twice a second.
    for process in psutil.Process(one.child.pid).children(recursive=True):
        with suppress(psutil.NoSuchProcess):
            process.kill()
    assert one.end() == 1
    assert "the session was lost" in one.text
    assert left_behind(one.child) == []
    two = terminal(*record_command(path))
    two.until("kept demo_0 partial ")
    two.until(" hangs]")
    two.type("q")
    assert two.end() == 0
    with open_session(path) as session:
        assert [info.stopped_by for info in session.infos().values()] == ["crashed"]


@pytest.mark.slow
def test_a_crash_of_the_simulation_costs_one_episode(terminal, tmp_path):
    one = terminal(*record_command(tmp_path / "s.h5"))
    one.begin()
    processes = psutil.Process(one.child.pid).children(recursive=True)
    # The fork server, the session, its episode.
    (episode,) = [each for each in processes if each.ppid() in {other.pid for other in processes if _deep(other, one)}]
    episode.send_signal(signal.SIGSEGV)
    one.until("kept demo_0 partial ")
    one.begin()
    one.type("n")
    one.until("kept demo_1 failure ")
    assert one.end() == 0
    with open_session(tmp_path / "s.h5") as session:
        assert [info.seed for info in session.infos().values()] == [0, 0]


@pytest.mark.slow
def test_a_correction_with_the_keyboard_is_marked_and_can_be_replayed(terminal, tmp_path):
    """The model never moves: it stops after eight steps, and again so long after each correction."""
    path, model = tmp_path / "s.h5", random_model("pickers", 20)
    model_io.save(replace(model, alpha=np.zeros_like(model.alpha)), tmp_path / "m.npz")
    one = terminal(*record_command(path, "--correct", tmp_path / "m.npz", "--no-window"))
    one.until(" hangs]")
    one.type("\r")
    one.until("Stopped: ")
    one.hold("s", 0.6)
    one.until("you are in control")
    one.until("Stopped: ")
    one.type("n")
    one.until("kept demo_0 failure ")
    assert one.end() == 0
    episode = check_replay(path, tmp_path)
    assert episode.source == "gp-word+keyboard"
    marked = [step.intervention for step in episode.steps]
    first, last = marked.index(True), len(marked) - marked[::-1].index(True)
    assert 0 < first < last < len(marked)
    assert all(marked[first:last])
    assert any(step.action.any() for step in episode.steps[first:last])
    assert not any(step.action.any() for step in (*episode.steps[:first], *episode.steps[last:]))


@pytest.fixture
def call(monkeypatch, tmp_path, capsys) -> Callable[..., tuple[int, str, str]]:
    """``call(*arguments)`` runs `layflat record s.h5 ...` in an empty folder, without display and gamepad."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")

    def run(*arguments: str) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as stop:
            main.main(["record", "s.h5", *arguments])
        return int(stop.value.code or 0), *capsys.readouterr()

    return run


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("mouse",), ("no display", "keyboard", "gamepad")),
        (("kinesthetic",), ("no display", "keyboard", "gamepad")),
        (("gamepad",), ("no gamepad is plugged in", "--source keyboard")),
        (("keyboard",), ("terminal", "--source gamepad or scripted")),
        (("mouse", "--no-window"), ("no display",)),
    ],
    ids=" ".join,
)
def test_a_missing_device_is_reported_with_what_works_instead(call, arguments, words):
    status, out, err = call("--source", *arguments)
    assert (status, out) == (1, "")
    assert err.count("\n") == 1
    assert all(word in err for word in words)
    assert not list(Path().iterdir())


@pytest.mark.parametrize(("source", "words"), [("mouse", "--no-window leaves none"), ("keyboard", "terminal")])
def test_no_window_is_opened_against_the_persons_wish(call, monkeypatch, source, words):
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.delenv("SDL_VIDEODRIVER", raising=False)
    status, out, err = call("--source", source, "--no-window")
    assert (status, out) == (1, "")
    assert words in err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--pad", "none.json"), "none.json"),
        (("--disturb-button", "hurricane"), "hurricane"),
        (("--cloth", "silk"), "silk"),
        (("--descriptor", "sift"), "sift"),
        (("--force",), "record appends"),
        (("--episodes", "0"), "episodes"),
        (("--source", "scripted", "--correct", "m.npz"), "--correct needs a person"),
        (("--correct", "missing.npz"), "missing.npz"),
        (("--correct", "m.npz", "--robot", "hanger"), "give --robot pickers"),
        (("--correct", "m.npz", "--robot", "pickers", "--descriptor", "how"), "give --descriptor"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_wrong_calls_are_refused_before_anything_is_opened(call, arguments, words):
    model_io.save(random_model("pickers", 20), Path("m.npz"))
    Path("s.h5").touch()
    status, out, err = call("--source", "keyboard", *arguments)
    assert (status, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1
    assert Path("s.h5").read_bytes() == b""
    assert {path.name for path in Path().iterdir()} == {"m.npz", "s.h5"}
