"""RecordConfig: settings of one `layflat record` call."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from layflat.app.workers.sim_options import parse_variation, sim_config
from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR
from layflat.policy.spec import SCRIPTED
from layflat.sim.cloth.spec import DEFAULT_CLOTH
from layflat.sim.conditions.variation import Variation
from layflat.sim.config import SimConfig
from layflat.sim.robots.registry import DEFAULT_ROBOT
from layflat.sim.tasks import DEFAULT_TASK


@dataclass(frozen=True, kw_only=True)
class RecordConfig:
    """Settings of one `layflat record` call: demonstrations of seeds that the session does not hold yet."""

    path: Path
    robot: str = DEFAULT_ROBOT
    task: str = DEFAULT_TASK
    cloth: str = DEFAULT_CLOTH
    settings: tuple[str, ...] = ()
    """Conditions, KEY=VALUE."""
    vary: tuple[str, ...] = ()
    """Names or files of variations."""
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

    def sim_config(self) -> SimConfig:
        """Return the simulation; UsageError where it is impossible."""
        return sim_config(self.settings, robot=self.robot, task=self.task, cloth=self.cloth, descriptor=self.descriptor)

    def variation(self) -> Variation:
        """Return the conditions that each seed draws; UsageError where they are wrong."""
        return parse_variation(self.vary, self.settings)
