"""RecordConfig: settings of one `layflat record` call."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR
from layflat.policy.spec import SCRIPTED
from layflat.sim.cloth.spec import DEFAULT_CLOTH
from layflat.sim.robots.registry import DEFAULT_ROBOT
from layflat.sim.tasks import DEFAULT_TASK


@dataclass(frozen=True, kw_only=True)
class RecordConfig:
    """Settings of one `layflat record` call: demonstrations of seeds that the session does not hold yet."""

    path: Path
    robot: str = DEFAULT_ROBOT
    task: str = DEFAULT_TASK
    cloth: str = DEFAULT_CLOTH
    source: str = SCRIPTED
    """Demonstrator: scripted, or a name of the workstation's TELEOPERATORS."""
    episodes: int = 1
    seed: int | None = None
    """First seed; None: the first one that the session holds, or 0. Seeds that it holds are left out."""
    descriptor: str = DEFAULT_DESCRIPTOR
    images: bool = False
    """Whether camera images are kept."""
    disturb: str = "push"
    """Disturbance that the device's disturb button starts."""
    window: bool | None = None
    """Whether to open the window, or None: where there is a display; this and the following are for a person."""
    mapping: Path | None = None
    """Mapping of a gamepad, written by `layflat gamepad calibrate --file`."""
    correct: Path | None = None
    """Model that places, and that the person corrects by taking over."""
    station: Path | None = None
    """File of a real station; ``twin``: the digital twin."""
    slow: float = 1.0
    yes: bool = False
