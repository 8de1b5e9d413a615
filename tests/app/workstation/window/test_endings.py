"""The window is ended in the middle of something: everything kept is on disk, and no process is left."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from layflat.app.workstation.window.launch import NO_DISPLAY
from layflat.data.session.reader import open_session
from layflat.data.session.recorder import SessionRecorder
from layflat.data.tools.validate import validate
from layflat.tests.factories import PICKERS

ROOT = Path(__file__).resolve().parents[4]
BASE = {**os.environ, "PYTHONPATH": str(ROOT.parent), "SDL_AUDIODRIVER": "dummy", "OMP_NUM_THREADS": "1"}
DUMMY = {**BASE, "SDL_VIDEODRIVER": "dummy"}
END_S = 90.0
pytestmark = pytest.mark.timeout(300)


@pytest.fixture
def folder(tmp_path: Path, make_episode: Callable, lying: Callable) -> Path:
    """With a session that has two demonstrations already."""
    add_demonstrations(tmp_path, range(2), make_episode, lying)
    return tmp_path


def add_demonstrations(folder: Path, seeds: range, make_episode: Callable, lying: Callable) -> None:
    with SessionRecorder(folder / "demos.h5", robot=PICKERS, cloth="towel", descriptor="word-axial") as recorder:
        for seed in seeds:
            made = make_episode(robot="pickers", seed=seed, descriptor="word-axial", disturbed=False)
            recorder.save(lying(made, 55))


def sit_down(folder: Path, what: str, *more: str, environment: dict[str, str] = DUMMY) -> subprocess.Popen[str]:
    """Start the process of a person, and wait until they are at work."""
    command = [sys.executable, "-m", "layflat.tests.app.workstation.person_process", str(folder), what, *more]
    process = subprocess.Popen(
        command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    for line in process.stdout:
        if line.startswith("at work"):
            return process
    raise AssertionError(process.stderr.read())


def end(process: subprocess.Popen[str], how: int | None) -> int:
    """End it, check that no process of it is left, and return its exit status."""
    family = psutil.Process(process.pid).children(recursive=True) if process.poll() is None else []
    if how is not None:
        process.send_signal(how)
    status = process.wait(END_S)
    _, left = psutil.wait_procs(family, timeout=45)
    for one in left:
        one.kill()
    assert not left, [one.pid for one in left]
    process.stdout.close()
    process.stderr.close()
    return status


def check_kept(folder: Path, what: str) -> None:
    """What was there is still there, and what ran was saved as partial."""
    path = folder / ("placed.h5" if what == "place" else "demos.h5")
    assert not validate(path)
    with open_session(path) as session:
        infos = list(session.infos().values())
    if what in ("record", "place"):
        assert infos[-1].outcome == "partial"
        assert infos[-1].n_steps >= 7
    assert [info.outcome for info in infos[:2]] == ["success", "success"] or what == "place"
    assert not list(folder.glob("*.npz")), "a model is whole or not there"


@pytest.mark.parametrize(("what", "how"), [("place", signal.SIGINT)])
def test_the_window_ends_in_the_middle(folder, what, how):
    process = sit_down(folder, what, *(["close"] if how is None else []))
    assert end(process, how) == (0 if how is None else 130)
    check_kept(folder, what)


@pytest.mark.slow
@pytest.mark.parametrize("what", ["record", "place", "train", "replay"])
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, None])
def test_the_window_ends_in_the_middle_of_everything(folder, what, how, make_episode, lying):
    if what == "train":  # Two would be trained before it could be ended.
        add_demonstrations(folder, range(2, 26), make_episode, lying)
    process = sit_down(folder, what, *(["close"] if how is None else []))
    assert end(process, how) == (0 if how is None else 130)
    check_kept(folder, what)


@pytest.mark.parametrize("what", ["record", pytest.param("place", marks=pytest.mark.slow)])
def test_a_killed_window_leaves_no_process_and_no_loss(folder, what):
    """The activity notices that the window has ended, and saves its steps."""
    process = sit_down(folder, what)
    assert end(process, signal.SIGKILL) == -signal.SIGKILL
    path = folder / ("placed.h5" if what == "place" else "demos.h5")
    SessionRecorder(path, robot=PICKERS, cloth="towel", descriptor="word-axial").close()
    check_kept(folder, what)


def test_without_a_display_the_error_says_what_works_instead(tmp_path):
    environment = {key: value for key, value in BASE.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [
        sys.executable,
        "-m",
        "layflat.app.cli.main",
        "record",
        str(tmp_path / "x.h5"),
        "--source",
        "mouse",
        "--window",
    ]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f"layflat: {NO_DISPLAY}\n"
    assert "--source keyboard" in NO_DISPLAY


@pytest.mark.parametrize("arguments", [("record", "x.h5", "--source", "mouse")])
def test_a_display_that_does_not_answer_is_reported(tmp_path, arguments):
    """SDL by itself would draw where nothing is seen."""
    environment = {key: value for key, value in BASE.items() if key not in ("SDL_VIDEODRIVER", "WAYLAND_DISPLAY")}
    done = subprocess.run(
        [sys.executable, "-m", "layflat.app.cli.main", *arguments],
        cwd=tmp_path,
        env={**environment, "DISPLAY": ":9999"},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 1
    (sentence,) = [line for line in done.stderr.splitlines() if line.startswith("layflat:")]
    assert "display :9999 does not answer" in sentence
    assert not (tmp_path / "x.h5").exists()


@pytest.fixture
def display(tmp_path: Path) -> Iterator[str]:
    """A real X server."""
    if shutil.which("Xvfb") is None:
        pytest.skip("Xvfb is not installed, so there is no real display to test on")
    read, write = os.pipe()
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", "1366x768x24", "-nolisten", "tcp"]
    server = subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL)
    os.close(write)
    with os.fdopen(read) as stream:
        number = stream.readline().strip()
    yield f":{number}"
    server.terminate()
    server.wait(10)


def test_on_a_real_display(folder, display):
    """On an X server the window has a name, and ends in the same way."""
    environment = {key: value for key, value in BASE.items() if key not in ("SDL_VIDEODRIVER", "WAYLAND_DISPLAY")}
    process = sit_down(folder, "record", environment={**environment, "DISPLAY": display})
    if shutil.which("xwininfo"):
        seen = subprocess.run(["xwininfo", "-root", "-tree", "-display", display], capture_output=True, text=True)
        assert "Layflat" in seen.stdout
    assert end(process, signal.SIGTERM) == 130
    check_kept(folder, "record")


def test_record_in_a_window_ends_with_its_last_episode(tmp_path, display):
    """`layflat record --source keyboard --episodes 1`: one line, one file, status 0, and the window has closed."""
    environment = {key: value for key, value in BASE.items() if key not in ("SDL_VIDEODRIVER", "WAYLAND_DISPLAY")}
    command = [sys.executable, "-m", "layflat.tests.app.workstation.person_process", str(tmp_path), "once"]
    done = subprocess.run(
        command, cwd=ROOT, env={**environment, "DISPLAY": display}, capture_output=True, text=True, timeout=240
    )
    assert done.returncode == 0, done.stderr
    (line,) = [line for line in done.stdout.splitlines() if line.startswith(("kept", "discarded"))]
    with open_session(tmp_path / "one.h5") as session:
        (episode,) = [session.episode(name) for name in session.names]
    assert line.startswith(f"kept demo_0 success {len(episode.steps)} steps contact ")
    assert line.endswith(str(tmp_path / "one.h5"))
    assert episode.source == "keyboard"
    # Both pickers went down.
    assert all(step.action[[2, 5]].max() <= 0 for step in episode.steps)
    assert min(step.action[2] for step in episode.steps) < 0
    names = {path.name for path in tmp_path.iterdir()}
    assert names - {"one.h5.parts"} == {"one.h5"}, "record writes its session and nothing else"
