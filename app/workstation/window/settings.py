"""What the window remembers between two times: ``workstation.json`` in its folder."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from layflat.data.atomic_files import write_text
from layflat.data.types import STEP_S
from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR, DESCRIPTORS
from layflat.sim.cloth.spec import CLOTHS
from layflat.sim.robots.registry import ROBOTS

FILE = "workstation.json"
SPEEDS = {"half": 0.5, "real time": 1.0, "double": 2.0, "as fast as it goes": 0.0}
"""Simulated over wall time, at most."""
SOURCES = ("gamepad", "keyboard", "mouse", "kinesthetic", "scripted")


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What a bench is made of and how fast it runs; a session that is there decides for itself."""

    robot: str = "hanger"
    cloth: str = "towel"
    source: str = "gamepad"
    descriptor: str = DEFAULT_DESCRIPTOR
    noise: bool = True
    """Depth noise of the camera."""
    speed: str = "real time"
    step_s: float = STEP_S
    images: bool = False
    session: str = "demos.h5"
    """In the folder."""
    model: str = ""
    policy: str = "gp-word"
    countdown_s: float = 3.0

    def __post_init__(self) -> None:
        """What a file of another version says wrong is as if it said nothing."""
        usual = {item.name: item.default for item in fields(self)}
        for name, known in (
            ("robot", ROBOTS), ("cloth", tuple(CLOTHS)), ("source", SOURCES), ("descriptor", tuple(DESCRIPTORS)),
            ("speed", tuple(SPEEDS)),
        ):  # fmt: skip
            if getattr(self, name) not in known:
                object.__setattr__(self, name, usual[name])
        for item in fields(self):
            if type(getattr(self, item.name)) is not type(item.default):
                object.__setattr__(self, item.name, item.default)

    def bench(self) -> dict[str, Any]:
        """The part of an order that says what the bench is made of."""
        names = ("robot", "cloth", "descriptor", "noise", "step_s", "images")
        return {name: getattr(self, name) for name in names} | {"speed": SPEEDS[self.speed]}


def load(folder: Path) -> Settings:
    """Those of the last time; the usual ones where there are none, or none that can be read."""
    try:
        told = json.loads((folder / FILE).read_text())
    except (OSError, ValueError):
        return Settings()
    known = {item.name for item in fields(Settings)}
    return Settings(**{name: value for name, value in dict(told).items() if name in known})


def with_one(settings: Settings, name: str, value: object) -> Settings:
    """The same with one thing changed, by its name."""
    return Settings(**{**asdict(settings), name: value})


def save(folder: Path, settings: Settings) -> None:
    write_text(folder / FILE, json.dumps(asdict(settings), indent=2) + "\n")
