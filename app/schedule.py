"""When a disturbance comes, how often, and which."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from sim.disturbances import DisturbanceSpec

Moment: TypeAlias = Literal["stopped", "tick", "contact"]


@dataclass(frozen=True, kw_only=True)
class When:
    """The moment at which a disturbance begins."""

    moment: Moment = "stopped"
    """After the policy has stopped, at a tick of placing, or when the camera's contact portion first reaches a value."""
    value: float = 0.0
    """The tick, or the contact portion."""


@dataclass(frozen=True, kw_only=True)
class ScheduledDisturbance:
    """One disturbance of an episode."""

    spec: DisturbanceSpec
    when: When = When()
    repeats: int = 1
