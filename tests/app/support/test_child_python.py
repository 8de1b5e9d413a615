"""Child processes in a folder that has modules of the same names as ours and as the standard library's."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from layflat.app.support.child_python import python_command
from layflat.app.workstation.window.subprocess_command import SubprocessCommand
from layflat.data.session.recorder import SessionRecorder
from layflat.tests.factories import HANGER

ROOT = Path(__file__).resolve().parents[3]
OWN = ("app", "data", "sim", "policy", "perception", "layflat")
FOREIGN = ("numpy", "cv2", "h5py", "random", "socket", "signal", "multiprocessing", "runpy")


@pytest.fixture
def hostile(tmp_path, monkeypatch, make_episode) -> Path:
    """A folder with a session, and with modules that fail when they are imported."""
    with SessionRecorder(tmp_path / "s.h5", robot=HANGER, cloth="towel") as recorder:
        recorder.save(make_episode(disturbed=False))
    for name in OWN:
        (tmp_path / name).mkdir()
    for path in (*(f"{name}/__init__.py" for name in OWN), *(f"{name}.py" for name in FOREIGN)):
        (tmp_path / path).write_text(f"raise SystemExit('{path} was imported from the current folder')\n")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT.parent), os.environ.get("PYTHONPATH", "")]).strip(":"))
    return tmp_path


@pytest.mark.parametrize("arguments", [["data", "info", "s.h5"], ["train", "s.h5", "m.npz", "--policy", "gmr"]])
def test_commands_of_the_window_import_nothing_from_the_current_folder(hostile, arguments):
    command = SubprocessCommand(arguments, folder=hostile)
    for thread in command._threads:
        thread.join()
    command._process.wait()
    assert command.status == 0, list(command.lines)


@pytest.mark.parametrize("server", ["activity", "fork_server"])
def test_servers_import_nothing_from_the_current_folder_and_stay_in_it(hostile, server):
    done = subprocess.run(
        python_command("layflat.tests.app.support.start_server", server),
        cwd=hostile, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, f"{hostile}\n"), done.stderr
