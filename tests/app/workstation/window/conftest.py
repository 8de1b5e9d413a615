"""Windows of tests, without a display."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from layflat.app.workers.sim_options import sim_config
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.session.status import SessionEvent
from layflat.app.workstation.window import display
from layflat.app.workstation.window.display import WindowMemory
from layflat.app.workstation.window.window import Window
from layflat.tests.app.workstation.person import Person, headless, unplug_all


def leftovers() -> list[str]:
    """Return child processes that still run, other than Python's own fork server and tracker."""
    found = []
    for process in psutil.Process().children(recursive=True):
        try:
            line = " ".join(process.cmdline())
        except psutil.Error:
            continue
        # The fork server's children carry its command line; itself, it is this process's own child.
        server = "multiprocessing" in line and process.ppid() == os.getpid()
        if not server and process.status() != psutil.STATUS_ZOMBIE:
            found.append(line)
    return found


@pytest.fixture
def sit_down(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Person]]:
    """``sit_down(robot, source, size=..., scale=..., **request)``: a person at a window that records into s.h5.

    ``person.events`` are the lines that the window has passed on.
    """
    headless()
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    made: list[Window] = []

    def make(
        robot: str = "pickers",
        source: str = "gamepad",
        *,
        size: tuple[int, int] = (1280, 720),
        scale: float = 1.0,
        **request: object,
    ) -> Person:
        monkeypatch.setattr(display, "display_scale", lambda: scale)
        if not display.memory_file().exists():
            display.save_memory(WindowMemory(width=size[0], height=size[1]))
        lines: list[SessionEvent] = []
        options = {"session": tmp_path / "s.h5", "seed": 0, "speed": 0.0, "countdown_s": 0.3} | request
        made.append(
            Window(
                SessionRequest(sim_config=sim_config(robot=robot, cloth="towel"), source=source, **options),  # type: ignore[arg-type]
                on_event=lines.append,
            )
        )
        return Person(made[-1], events=lines)

    yield make
    # SDL crashes where it ends before a gamepad does.
    unplug_all()
    for each in made:
        each.close()
    assert leftovers() == []
