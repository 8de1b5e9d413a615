"""A person at a real X server: Xvfb, xdotool, and a window manager where there is one."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import psutil
import pytest
from PIL import ImageGrab

from layflat.app.media.cloth_colors import HOLDER
from layflat.data.session.reader import open_session
from layflat.data.tools.validate import validate

ROOT = Path(__file__).resolve().parents[3]
BASE = {
    **{key: value for key, value in os.environ.items() if key not in ("SDL_VIDEODRIVER", "WAYLAND_DISPLAY")},
    "PYTHONPATH": str(ROOT.parent),
    "SDL_AUDIODRIVER": "dummy",
    "OMP_NUM_THREADS": "1",
}
PATIENCE_S = 90.0


def eventually(until: Callable[[], object], what: str, seconds: float = PATIENCE_S) -> None:
    give_up = time.monotonic() + seconds
    while not until():
        assert time.monotonic() < give_up, f"waited {seconds:.0f} s for {what}"
        time.sleep(0.05)


class Display:
    """An X server of some size, and keys and clicks on it."""

    def __init__(self, name: str, *, managed: bool) -> None:
        self.name = name
        self.managed = managed
        """Whether there is a window manager."""

    def xdotool(self, *arguments: object) -> str:
        command = ["xdotool", *map(str, arguments)]
        done = subprocess.run(command, env=BASE | {"DISPLAY": self.name}, capture_output=True, text=True, timeout=30)
        return done.stdout.strip()

    def window(self) -> str:
        """Return the number of the program's window, once it is seen."""
        found: list[str] = []

        def search() -> bool:
            found[:] = self.xdotool("search", "--onlyvisible", "--class", "layflat").split()
            return bool(found)

        eventually(search, "the window")
        self.xdotool("windowfocus", found[0])
        return found[0]

    def key(self, *names: str) -> None:
        for name in names:
            self.xdotool("key", name)

    def close_window(self) -> None:
        """Press the X of the window."""
        subprocess.run(["wmctrl", "-c", "Layflat"], env=BASE | {"DISPLAY": self.name}, check=True, timeout=30)

    def picture(self) -> np.ndarray:
        """Return what is seen, (H, W, 3)."""
        return np.asarray(ImageGrab.grab(xdisplay=self.name).convert("RGB"))


@contextmanager
def x_display(
    size: str = "1280x720", dpi: int = 96, *, managed: bool = False, shared_memory: bool = True
) -> Iterator[Display]:
    """Start a display; skip the test where the programs are missing. Without shared memory it is as by `ssh -X`."""
    for program in ("Xvfb", "xdotool", *(("openbox", "wmctrl") if managed else ())):
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed, so there is no real display to test on")
    read, write = os.pipe()
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", f"{size}x24", "-dpi", str(dpi), "-nolisten", "tcp"]
    command += [] if shared_memory else ["-extension", "MIT-SHM"]
    server = subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL)
    os.close(write)
    with os.fdopen(read) as stream:
        name = f":{stream.readline().strip()}"
    manager = (
        subprocess.Popen(["openbox"], env=BASE | {"DISPLAY": name}, stderr=subprocess.DEVNULL) if managed else None
    )
    try:
        yield Display(name, managed=managed)
    finally:
        for process in filter(None, (manager, server)):
            process.terminate()
            process.wait(10)


class Recorder:
    """`layflat record FILE --window` as a person starts it."""

    def __init__(self, display: Display, folder: Path, *options: str) -> None:
        self.display, self.path = display, folder / "demos.h5"
        words = [sys.executable, "-m", "layflat.app.cli.main", "record", str(self.path), "--window", *options]
        self._err = (folder / "stderr").open("w+")
        self._process = subprocess.Popen(
            words, cwd=ROOT, stdout=subprocess.PIPE, stderr=self._err, text=True, start_new_session=True,
            env=BASE | {"DISPLAY": display.name, "XDG_CONFIG_HOME": str(folder / "config")},
        )  # fmt: skip

    def journals(self) -> list[Path]:
        return list(self.path.parent.glob("demos.h5.parts/*.journal"))

    def hangs(self) -> bool:
        """Return whether the cloth of a demonstration hangs."""
        return any(one.stat().st_size for one in self.journals())

    def go(self, state: str) -> None:
        """Go on to a state, by keys."""
        self.display.window()
        if state == "starting":
            return
        eventually(self.hangs, "the cloth to hang")
        time.sleep(0.5)
        if state == "waiting":
            return
        self.display.key("Return")
        if state == "countdown":
            time.sleep(0.7)
            return
        time.sleep(3.6)
        if state == "still":
            return
        size = sum(one.stat().st_size for one in self.journals())
        self.display.xdotool("keydown", "Down")
        eventually(lambda: sum(one.stat().st_size for one in self.journals()) > size + 12_000, "some steps")
        if state in ("paused", "asking"):
            self.display.xdotool("keyup", "Down")
            self.display.key("space" if state == "paused" else "y")  # It hangs, and is no success.
            time.sleep(0.5)

    def guide(self) -> None:
        """Take hold of the hanger, which is yellow, and guide it down."""
        size = sum(one.stat().st_size for one in self.journals())
        rows, columns = np.nonzero(np.abs(self.display.picture().astype(int) - HOLDER).max(axis=-1) < 40)
        middle = np.argmin(np.abs(columns - np.median(columns)) + np.abs(rows - rows.min()))
        x, y = int(columns[middle]), int(rows[middle])
        self.display.xdotool("mousemove", x, y, "mousedown", 1, "sleep", "0.2", "mousemove", x, y + 60)
        eventually(lambda: sum(one.stat().st_size for one in self.journals()) > size + 12_000, "some steps")

    def signal(self, number: int) -> None:
        self._process.send_signal(number)

    def ended(self) -> tuple[int, list[str], str]:
        """Return exit status, lines and errors; no process is left."""
        family = psutil.Process(self._process.pid).children(recursive=True) if self._process.poll() is None else []
        out, _ = self._process.communicate(timeout=PATIENCE_S)
        _, left = psutil.wait_procs(family, timeout=45)
        for one in left:
            one.kill()
        assert not left, [one.pid for one in left]
        self._err.seek(0)
        errors = self._err.read()
        self._err.close()
        return self._process.returncode, out.splitlines(), errors

    def outcomes(self) -> list[str]:
        """Return the outcomes in the session, which is whole."""
        if not self.path.exists():
            return []
        assert not validate(self.path)
        with open_session(self.path) as session:
            return [info.outcome for info in session.infos().values()]

    def kill(self) -> None:
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
