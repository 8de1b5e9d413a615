"""The window is ended in every state, on a real display: status 0, everything is on disk, and no process is left."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from layflat.app.benchmarks.measure import random_model
from layflat.app.workstation.window.launch import NO_DISPLAY
from layflat.data.session.recorder import SessionRecorder
from layflat.policy import model_io
from layflat.tests.app.workstation.x_display import BASE, ROOT, Display, Recorder, eventually, x_display
from layflat.tests.factories import PICKERS

pytestmark = pytest.mark.timeout(300)
OPTIONS = ("--source", "keyboard", "--robot", "pickers", "--episodes", "5")
STATES = ("starting", "waiting", "countdown", "still", "running", "paused", "asking")
ENDS: dict[str, Callable[[Recorder], None]] = {
    "X": lambda recorder: recorder.display.close_window(),
    "Alt+F4": lambda recorder: recorder.display.key("alt+F4"),
    "Esc": lambda recorder: recorder.display.key("Escape"),
    "q": lambda recorder: recorder.display.key("q"),
    "Ctrl-C": lambda recorder: recorder.signal(signal.SIGINT),
    "SIGTERM": lambda recorder: recorder.signal(signal.SIGTERM),
    "destroyed": lambda recorder: print(recorder.display.xdotool("windowclose", recorder.display.window())),
}


@pytest.fixture(scope="module")
def display() -> Iterator[Display]:
    with x_display(managed=True) as made:
        yield made


def check_ending(display: Display, folder: Path, state: str, end: str, model: Path | None = None) -> None:
    recorder = Recorder(display, folder, *(OPTIONS if model is None else (*OPTIONS, "--correct", str(model))))
    try:
        recorder.go("waiting" if model else state)
        if model is not None:
            display.key("Return")
            eventually(lambda: any(one.stat().st_size > 20_000 for one in recorder.journals()), "the policy to place")
        check_end(recorder, state, end)
    finally:
        display.xdotool("keyup", "Down")
        recorder.kill()


def check_end(recorder: Recorder, state: str, end: str) -> None:
    ENDS[end](recorder)
    status, lines, errors = recorder.ended()
    assert (status, errors.count("layflat:"), "Traceback" in errors) == (0, 0, False), errors
    kept = ["partial"] if state in ("running", "paused", "asking", "placing", "guided") else []
    assert recorder.outcomes() == kept
    assert [line.split()[:3] for line in lines] == [["kept", "demo_0", "partial"]] * len(kept)
    assert not recorder.journals()
    assert {path.name for path in recorder.path.parent.iterdir()} <= {"demos.h5", "demos.h5.parts", "config", "stderr"}


@pytest.mark.parametrize(("state", "end"), [("starting", "SIGTERM"), ("waiting", "X"), ("running", "Esc")])
def test_the_window_ends(display, tmp_path, state, end):
    check_ending(display, tmp_path, state, end)


@pytest.mark.slow
@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("end", ENDS)
def test_the_window_ends_in_every_state(display, tmp_path, state, end):
    check_ending(display, tmp_path, state, end)


@pytest.mark.slow
@pytest.mark.parametrize("end", ["X", "Esc", "Ctrl-C", "SIGTERM"])
def test_the_window_ends_while_the_mouse_guides_the_hanger(display, tmp_path, end):
    recorder = Recorder(display, tmp_path, "--source", "kinesthetic", "--robot", "hanger", "--episodes", "5")
    try:
        recorder.go("still")
        recorder.guide()
        check_end(recorder, "guided", end)
    finally:
        display.xdotool("mouseup", 1)
        recorder.kill()


@pytest.mark.slow
@pytest.mark.parametrize("end", ["X", "Esc", "Ctrl-C", "SIGTERM"])
def test_the_window_ends_while_a_policy_places(display, tmp_path_factory, tmp_path, end):
    model = tmp_path_factory.mktemp("model") / "m.npz"
    model_io.save(random_model("pickers", 20), model)
    check_ending(display, tmp_path, "placing", end, model)


def test_a_killed_window_leaves_no_process_and_no_loss(display, tmp_path):
    """The session notices that the window has ended, and saves its steps."""
    recorder = Recorder(display, tmp_path, *OPTIONS)
    recorder.go("running")
    recorder.signal(signal.SIGKILL)
    status, _, _ = recorder.ended()
    display.xdotool("keyup", "Down")
    assert status == -signal.SIGKILL
    SessionRecorder(recorder.path, robot=PICKERS, cloth="towel", descriptor="word-axial").close()
    assert recorder.outcomes() == ["partial"]


@pytest.mark.slow
def test_the_window_ends_with_its_last_episode(display, tmp_path):
    """`layflat record --source keyboard --episodes 1`: one line, one file, status 0, and the window has closed."""
    recorder = Recorder(display, tmp_path, *OPTIONS[:-1], "1")
    try:
        recorder.go("running")
        time.sleep(1.0)
        display.xdotool("keyup", "Down")
        display.key("n")
        status, lines, errors = recorder.ended()
    finally:
        recorder.kill()
    assert status == 0, errors
    assert lines[0].startswith("kept demo_0 failure ")
    assert lines[0].endswith(str(recorder.path))
    assert recorder.outcomes() == ["failure"]


@pytest.mark.parametrize("arguments", [("--window",), ("--source", "mouse")])
def test_without_a_display_the_error_says_what_works_instead(tmp_path, arguments):
    environment = {key: value for key, value in BASE.items() if key != "DISPLAY"}
    words = ["record", str(tmp_path / "x.h5"), "--source", "keyboard", *arguments]
    done = run(words, environment)
    assert (done.returncode, done.stdout) == (1, "")
    if "--window" in arguments:
        assert done.stderr == f"layflat: {NO_DISPLAY}\n"
    assert "--source keyboard" in done.stderr
    assert not list(tmp_path.iterdir())


def test_a_display_that_does_not_answer_is_reported(tmp_path):
    """SDL by itself would draw where nothing is seen."""
    done = run(["record", str(tmp_path / "x.h5"), "--source", "mouse"], BASE | {"DISPLAY": ":9999"})
    assert done.returncode == 1
    (sentence,) = [line for line in done.stderr.splitlines() if line.startswith("layflat:")]
    assert "display :9999 does not answer" in sentence
    assert not (tmp_path / "x.h5").exists()


def run(words: list[str], environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "layflat.app.cli.main", *words]
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=60)
