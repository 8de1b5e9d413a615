"""The seam between a recording and the episode that is recorded, wherever that runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeAlias

from layflat.app.support.errors import LayflatError
from layflat.app.workstation.teleop.teleop_input import TeleopInput
from layflat.data.session.saved_episode import SavedEpisode
from layflat.data.types import DragTarget, Outcome, StoppedBy


@dataclass(frozen=True, kw_only=True)
class EpisodeStatus:
    """How an episode stands after a step; what a status line or a window tells of it."""

    n_steps: int = 0
    time_s: float = 0.0
    """Simulated."""
    contact_portion: float = 0.0
    word: tuple[float, float] = (0.0, 0.0)
    holder_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    flat_area: float = 0.0
    stopped_by: StoppedBy | None = None
    """Not None: the bench takes no further steps."""
    disturbed: bool = False
    led: bool = False
    """The person has the lead over a policy."""


class EpisodeHandle(Protocol):
    """One episode that a person makes. Made with a seed; its bench may still be getting ready."""

    seed: int

    def ready(self) -> bool:
        """Whether the cloth hangs and ``glance`` and ``step`` may be called; never waits. EpisodeLost if it died."""

    def glance(self) -> EpisodeStatus:
        """How it stands."""

    def step(self, reading: TeleopInput, pull: DragTarget | None = None) -> EpisodeStatus:
        """One step of what the reading says; returns when it is over. EpisodeLost if the simulation died."""

    def disturb(self, name: str) -> None:
        """Begin a named disturbance with the next step."""

    def hand_back(self) -> None:
        """The person has done, and the policy that they corrected leads with the next step."""

    def keep(self, outcome: Outcome, stopped_by: StoppedBy) -> SavedEpisode | None:
        """End it and keep it, durable on return; None where not even one step was over."""

    def discard(self) -> None:
        """End it, and nobody wants it. May be called twice."""


class EpisodeLost(LayflatError):
    """The simulation of a take ended by itself; says why. What there is of it can still be kept."""


HandleFactory: TypeAlias = Callable[[int], EpisodeHandle]
"""Makes the take of a seed; returns at once."""
