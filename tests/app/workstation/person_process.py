"""A person at a window in a process of its own, until the process is ended from outside.

``python -m layflat.tests.app.workstation.person_process FOLDER record|place|train|replay [close]`` prints ``at work``
in the middle of that; ``close`` closes the window at that moment. ``FOLDER once`` is `layflat record --source keyboard
--episodes 1` with a person at its window, on a real display; more options may follow.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pygame

from layflat.app.cli import main
from layflat.app.support.errors import run_command
from layflat.app.workstation.session.activities import make_activity
from layflat.app.workstation.window import window as window_module
from layflat.app.workstation.window.pages.place import PlacePage
from layflat.app.workstation.window.pages.replay import ReplayPage
from layflat.app.workstation.window.pages.train import TrainPage
from layflat.app.workstation.window.window import Window
from layflat.tests.app.workstation.person import Person, post


def record(person: Person) -> None:
    pad = person.plug_in()
    person.menu("Start")
    person.begin()
    pad.axis("left_y", 0.3)
    person.wait(lambda: person.status.get("steps", 0) >= 8, "8 steps")


def place(person: Person) -> None:
    person.tab("Place")
    page = person.window.page
    assert isinstance(page, PlacePage)
    page.record = "placed"
    page.build()
    person.menu("Place")
    person.wait(lambda: person.status.get("steps", 0) >= 8, "8 steps")


def train(person: Person) -> None:
    person.tab("Train")
    page = person.window.page
    assert isinstance(page, TrainPage)
    person.menu("Train")
    person.wait(lambda: page.command is not None and bool(page.command.activity), "the training")


def replay(person: Person) -> None:
    person.tab("Replay")
    page = person.window.page
    assert isinstance(page, ReplayPage)
    person.menu("Repeat the actions")
    person.menu("Watch")
    person.wait(lambda: page.at > 2, "the replay")


def sit(folder: Path, what: str, close: bool) -> int:
    window = Window(folder, make_activity)
    try:
        settings = replace(
            window.context.settings, robot="pickers", session="demos.h5", countdown_s=0.3, model="scripted"
        )
        window.context.change_settings(settings)
        window.page.on_resize()
        person = Person(window)
        {"record": record, "place": place, "train": train, "replay": replay}[what](person)
        print("at work", flush=True)
        if close:
            pygame.event.post(pygame.event.Event(pygame.QUIT))
        return window.run()
    finally:
        window.close()


class Watched(window_module.Window):
    """A window that the person can find."""

    newest: Watched | None = None

    def __init__(self, *arguments: object, **options: object) -> None:
        super().__init__(*arguments, **options)  # type: ignore[arg-type]
        Watched.newest = self


def demonstrate_once() -> None:
    """Press Enter, down for a while, and y, beside the window's own rounds."""

    def wait(until: Callable[[dict], bool]) -> None:
        give_up = time.monotonic() + 150
        while Watched.newest is None or not until(Watched.newest.context.client.status):
            if time.monotonic() > give_up:
                return
            time.sleep(0.02)

    wait(lambda status: status.get("state") == "waiting" and status["ready"])
    post(pygame.KEYDOWN, key=pygame.K_RETURN, mod=0, unicode="")
    wait(lambda status: status.get("state") == "running")
    post(pygame.KEYDOWN, key=pygame.K_DOWN, mod=0, unicode="")
    wait(lambda status: status.get("steps", 0) >= 6)
    post(pygame.KEYUP, key=pygame.K_DOWN, mod=0)
    post(pygame.KEYDOWN, key=pygame.K_y, mod=0, unicode="y")


def once(folder: Path, more: list[str]) -> None:
    window_module.Window = Watched  # type: ignore[misc]
    threading.Thread(target=demonstrate_once, daemon=True).start()
    arguments = ["record", str(folder / "one.h5"), "--source", "keyboard", "--episodes", "1", "--robot", "pickers"]
    main.main([*arguments, *more])


if __name__ == "__main__":
    if sys.argv[2] == "once":
        once(Path(sys.argv[1]), sys.argv[3:])
    sys.exit(run_command(lambda: sit(Path(sys.argv[1]), sys.argv[2], "close" in sys.argv[3:]), debug=True))
