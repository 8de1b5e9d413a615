"""Protocol between a recording and the episode that is recorded, wherever that runs."""

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
    """State of an episode after a step, as status lines and windows show it."""

    n_steps: int = 0
    time_s: float = 0.0
    """Simulated time."""
    contact_portion: float = 0.0
    holder_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    flat_area: float = 0.0
    stopped_by: StoppedBy | None = None
    """Why no further steps are taken, or None."""
    disturbed: bool = False
    human_in_control: bool = False
    """Whether the person, not the policy, is in control."""


class EpisodeHandle(Protocol):
    """One episode of a person. Made with a seed; its simulation may still be starting."""

    seed: int

    def ready(self) -> bool:
        """Return whether the cloth hangs and steps can be taken; never wait. EpisodeLost if the process died."""

    def status(self) -> EpisodeStatus:
        """Return the state after the last step."""

    def step(self, teleop: TeleopInput, drag: DragTarget | None = None) -> EpisodeStatus:
        """Run one step and wait for it; EpisodeLost if the simulation died."""

    def disturb(self, name: str) -> None:
        """Start a named disturbance with the next step."""

    def release_control(self) -> None:
        """Return control to the policy with the next step."""

    def save(self, outcome: Outcome, stopped_by: StoppedBy) -> SavedEpisode | None:
        """End the episode and save it, durable on return; None where it has no steps."""

    def discard(self) -> None:
        """End the episode and delete its steps; may be called twice."""


class EpisodeLost(LayflatError):
    """The process of an episode ended by itself. The steps so far can still be saved."""


HandleFactory: TypeAlias = Callable[[int], EpisodeHandle]
"""Makes the episode of a seed; returns at once."""
