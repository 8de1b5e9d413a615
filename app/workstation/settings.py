"""Settings of the window, which it keeps in ``workstation.json`` in its folder."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from layflat.app.workstation.teleop.registry import TELEOPERATORS
from layflat.data.atomic_files import write_text
from layflat.data.types import STEP_S
from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR, DESCRIPTORS
from layflat.sim.cloth.registry import CLOTHS
from layflat.sim.config import SimConfig
from layflat.sim.robots.registry import ROBOTS

FILE = "workstation.json"
SPEEDS = {"half": 0.5, "real time": 1.0, "double": 2.0, "as fast as possible": 0.0}
"""Simulated over wall time, at most."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Parts and speed of the simulation; a session that exists keeps its own."""

    robot: str = next(iter(ROBOTS))
    cloth: str = next(iter(CLOTHS))
    source: str = TELEOPERATORS[0]
    descriptor: str = DEFAULT_DESCRIPTOR
    noise: bool = True
    """Depth noise of the camera."""
    speed: str = "real time"
    step_s: float = STEP_S
    images: bool = False
    """Whether camera images are saved."""
    session: str = "demos.h5"
    """Session file in the folder."""
    model: str = ""
    policy: str = "gp-word"
    own_policy: str = ""
    """Policy of the person's own: a factory, an entry point or a server."""
    countdown_s: float = 3.0
    dark: bool = False
    """Whether the pages are dark."""

    def __post_init__(self) -> None:
        """Replace values that a file of another version has and that do not exist, or have the wrong type."""
        choices = {
            "robot": ROBOTS, "cloth": CLOTHS, "source": TELEOPERATORS, "descriptor": DESCRIPTORS, "speed": SPEEDS,
        }  # fmt: skip
        for item in fields(self):
            value = getattr(self, item.name)
            if type(value) is not type(item.default) or value not in choices.get(item.name, [value]):
                object.__setattr__(self, item.name, item.default)

    def sim_config(self, **values: Any) -> SimConfig:
        """Return the settings of the simulation, with some values changed."""
        names = ("robot", "cloth", "descriptor", "noise", "step_s")
        return SimConfig(**({name: getattr(self, name) for name in names} | values))


def load(folder: Path) -> Settings:
    """Return the settings kept in a folder; the defaults where there are none, or none that can be read."""
    try:
        values = dict(json.loads((folder / FILE).read_text()))
    except (OSError, ValueError):
        return Settings()
    known = {item.name for item in fields(Settings)}
    return Settings(**{name: value for name, value in values.items() if name in known})


def save(folder: Path, settings: Settings) -> None:
    """Write the settings into a folder."""
    write_text(folder / FILE, json.dumps(asdict(settings), indent=2) + "\n")
