"""One person in a process of its own, in the middle of something, until the process is ended from outside.

``python -m tests.app.workstation.sitting FOLDER record|place|train|replay [close]``; says ``at work`` when it is. On
whatever display there is; ``close`` clicks the window away at that moment.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pygame

from app.errors import run_guarded
from app.workstation.modes.place import PlaceMode
from app.workstation.modes.replay import ReplayMode
from app.workstation.modes.train import TrainMode
from app.workstation.window import Window
from app.workstation.works import make_work
from tests.app.workstation.person import Person


def record(person: Person) -> None:
    pad = person.plug_in()
    person.menu("Begin")
    person.begin()
    pad.axis("left_y", 0.3)
    person.wait(lambda: person.status.get("ticks", 0) >= 8, "8 ticks")


def place(person: Person) -> None:
    person.tab("Place")
    mode = person.window.mode
    assert isinstance(mode, PlaceMode)
    mode.record = "placed"
    mode.build()
    person.menu("Place")
    person.wait(lambda: person.status.get("ticks", 0) >= 8, "8 ticks")


def train(person: Person) -> None:
    person.tab("Train")
    mode = person.window.mode
    assert isinstance(mode, TrainMode)
    person.menu("Train")
    person.wait(lambda: mode.job is not None and bool(mode.job.doing), "the training")


def replay(person: Person) -> None:
    person.tab("Replay")
    mode = person.window.mode
    assert isinstance(mode, ReplayMode)
    person.menu("Run the actions again")
    person.menu("Watch")
    person.wait(lambda: mode.at > 2, "the replay")


def sit(folder: Path, what: str, close: bool) -> int:
    window = Window(folder, make_work)
    try:
        settings = replace(window.shop.settings, task="pickers", session="demos.h5", countdown_s=0.3, model="scripted")
        window.shop.change(settings)
        window.mode.relaid()
        person = Person(window)
        {"record": record, "place": place, "train": train, "replay": replay}[what](person)
        print("at work", flush=True)
        if close:
            pygame.event.post(pygame.event.Event(pygame.QUIT))
        return window.run()
    finally:
        window.close()


if __name__ == "__main__":
    sys.exit(run_guarded(lambda: sit(Path(sys.argv[1]), sys.argv[2], "close" in sys.argv[3:]), debug=True))
