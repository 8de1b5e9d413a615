"""What is to be recorded: one value from the command line to whatever records it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class RecordConfig:
    """Demonstrations of seeds ``seed``, ``seed + 1``, ... into a session."""

    path: Path
    robot: str
    cloth: str
    source: str
    """Who demonstrates: scripted, or a device of layflat.app.workstation.teleop.registry.SOURCES."""
    episodes: int
    seed: int
    descriptor: str
    images: bool
    """Whether camera images are kept."""
    disturb: str = "none"
    """What the device's button for it does to the cloth."""
    window: bool = True
    """In the window where there is a display, else in the terminal. This and the rest are for a person."""
    mapping: Path | None = None
    """Of a pad, by `layflat gamepad calibrate --file`."""
    correct: Path | None = None
    """A model that places, and that the person corrects by taking over."""
