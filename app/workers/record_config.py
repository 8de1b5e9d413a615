"""RecordConfig: settings of one `layflat record` call."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class RecordConfig:
    """Settings of one `layflat record` call: demonstrations of seeds ``seed``, ``seed + 1``, ... into a session."""

    path: Path
    robot: str
    task: str = "place"
    cloth: str
    source: str
    """Who demonstrates: scripted, or a name of the workstation's TELEOPERATORS."""
    episodes: int
    seed: int
    descriptor: str
    images: bool
    """Whether camera images are kept."""
    disturb: str = "none"
    """Disturbance that the device's disturb button starts."""
    window: bool = True
    """Whether to open the window where there is a display; this and the following are for a person."""
    mapping: Path | None = None
    """Mapping of a gamepad, written by `layflat gamepad calibrate --file`."""
    correct: Path | None = None
    """Model that places, and that the person corrects by taking over."""
