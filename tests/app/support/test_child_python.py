"""Every process that is started, where the current folder and PYTHONPATH hold modules named as ours and as others'."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import pytest

from layflat.app.cli.entry import put_user_path_last
from layflat.app.support.child_python import SOCKET_NAME, SOCKET_PATH_MAX
from layflat.app.workstation.subprocess_command import SubprocessCommand
from layflat.data.session.recorder import SessionRecorder
from layflat.tests.app.workstation.pty_terminal import Terminal
from layflat.tests.factories import HANGER

ROOT = Path(__file__).resolve().parents[3]
OURS = ("app", "data", "sim", "policy", "perception", "tests")
OTHERS = {
    *("numpy", "cv2", "h5py", "scipy", "pandas", "sklearn", "matplotlib", "pybullet", "pygame", "gymnasium", "GPy"),
    *("typer", "rich", "jinja2", "pebble", "PIL", "psutil", "tomli", "platformdirs", "ray", "pyarrow"),
}
ENTRY = "from layflat.app.cli.entry import main\nif __name__ == '__main__': main()\n"
SERVER = (
    "import sys; from layflat.app.cli.entry import put_user_path_last; put_user_path_last();"
    "from layflat.tests.app.support.start_server import main\nif __name__ == '__main__': main(sys.argv[1])\n"
)
"""As the script that pip makes of an entry point."""


def fill(folder: Path, names: set[str]) -> Path:
    """Make a module of each name, which leaves a trace and fails when it is imported."""
    folder.mkdir()
    for name in names:
        text = f"open({str(folder / 'imported')!r}, 'a').write({name!r} + '\\n'); raise SystemExit({name!r})\n"
        (folder / f"{name}.py").write_text(text)
    return folder


def loaded_at_start() -> set[str]:
    """Return what Python and the import of the package alone have loaded, before the program can do anything."""
    words = [sys.executable, "-c", "import layflat.app.cli.entry, sys; print(*sys.modules)"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return {name.partition(".")[0] for name in done.stdout.split()}


class Hostile:
    """Folders of such modules: the current one, and one in PYTHONPATH."""

    def __init__(self, folder: Path) -> None:
        standard = {name for name in sys.stdlib_module_names if name[0] != "_" and find_spec(name)}
        self.here = fill(folder / "here", {*OURS, *OTHERS, *standard, "layflat"})
        self.there = fill(folder / "there", {*OURS, *OTHERS, *(standard - loaded_at_start())})
        self.env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(self.there), str(ROOT.parent)])}

    def program(self, text: str = ENTRY) -> tuple[str, str]:
        script = self.here.parent / "layflat-script"
        script.write_text(text)
        return sys.executable, str(script)

    def run(self, *arguments: str, text: str = ENTRY) -> subprocess.CompletedProcess[str]:
        words = [*self.program(text), *arguments]
        return subprocess.run(words, cwd=self.here, env=self.env, capture_output=True, text=True, timeout=100)

    def imported(self) -> str:
        return "".join(path.read_text() for path in (self.here.parent).glob("*/imported"))


@pytest.fixture
def hostile(tmp_path, make_episode) -> Hostile:
    made = Hostile(tmp_path)
    with SessionRecorder(made.here / "s.h5", robot=HANGER, cloth="towel") as recorder:
        recorder.save(make_episode(disturbed=False))
    return made


@pytest.mark.parametrize(
    "arguments",
    [
        "record new.h5 --episodes 1 --workers 1",  # Processes of workers
        "data validate s.h5",  # The sandbox
        "train s.h5 m.npz --policy gmr",
    ],
)
def test_a_command_imports_nothing_of_the_users(hostile, arguments):
    done = hostile.run(*arguments.split())
    assert done.returncode == 0, done.stderr
    assert not hostile.imported()


def test_recording_by_hand_imports_nothing_of_the_users(hostile):
    terminal = Terminal(
        *("record", "new.h5", "--source", "keyboard", "--no-window"),
        program=hostile.program(), cwd=hostile.here, env=hostile.env,
    )  # fmt: skip
    try:
        terminal.until(" hangs]")
        terminal.type("q")
        assert terminal.end() == 0, terminal.text
    finally:
        terminal.close()
    assert not hostile.imported()


@pytest.mark.parametrize("server", ["session", "fork_server"])
def test_servers_import_nothing_of_the_users_and_stay_in_the_folder(hostile, server):
    done = hostile.run(server, text=SERVER)
    assert (done.returncode, done.stdout) == (0, f"{hostile.here}\n"), done.stderr
    assert not hostile.imported()


def test_commands_of_the_window_import_nothing_of_the_users(hostile, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(hostile.there))
    command = SubprocessCommand(["data", "info", "s.h5"], folder=hostile.here)
    for thread in command._threads:
        thread.join()
    command._process.wait()
    assert command.status == 0, list(command.lines)
    assert not hostile.imported()


def test_modules_that_only_pythonpath_has_can_still_be_imported(tmp_path, monkeypatch):
    theirs, ours, others = (str(tmp_path / name) for name in ("theirs", "ours", "others"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([theirs, str(ROOT.parent)]))
    monkeypatch.setattr(sys, "path", [theirs, str(ROOT.parent), ours, others])
    put_user_path_last()
    assert sys.path == [str(ROOT.parent), ours, others, theirs]


@pytest.mark.parametrize("length", [SOCKET_PATH_MAX - len(SOCKET_NAME), 240])
def test_a_folder_for_temporary_files_with_a_path_of_any_length(hostile, tmp_path, length):
    long = tmp_path / "x"
    while len(str(long)) < length:
        long /= "x" * min(length - len(str(long)) - 1, 200)
    long.mkdir(parents=True)
    hostile.env["TMPDIR"] = str(long)
    done = hostile.run("session", text=SERVER)
    assert (done.returncode, done.stdout) == (0, f"{hostile.here}\n"), done.stderr


def test_where_no_folder_is_short_enough_the_sentence_names_what_helps(tmp_path, monkeypatch, start_server):
    monkeypatch.setattr("tempfile.tempdir", "/" + "x" * 120)
    monkeypatch.setattr("os.access", lambda *_: False)
    assert "set TMPDIR to a folder whose path has at most 75 bytes" in start_server()


@pytest.fixture
def start_server() -> Callable[[], str]:
    from layflat.app.support.child_python import fork_server_context
    from layflat.app.support.errors import LayflatError

    def start() -> str:
        with pytest.raises(LayflatError) as error:
            fork_server_context([])
        return str(error.value)

    return start
