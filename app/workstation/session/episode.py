"""EpisodeHandle: what a session asks of the episode that it runs, wherever that is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from layflat.app.support.errors import LayflatError
from layflat.app.workstation.session.status import EpisodeStatus
from layflat.data.session.saved_episode import SavedEpisode


class EpisodeHandle:
    """One episode, which runs elsewhere: no call waits for it, and what is asked for is done in this order."""

    seed: int
    status: EpisodeStatus | None = None
    """Newest state; None while the cloth is being hung."""
    ended: bool = False
    """Whether ``save`` is done."""
    saved: SavedEpisode | None = None
    """What was saved; None where the episode had no steps."""

    @property
    def busy(self) -> bool:
        """Whether something that was asked for is not done yet."""
        raise NotImplementedError

    def ask(self, name: str, *details: Any) -> None:
        """Ask for something by its name; `poll` takes the answer.

        ``step`` (phase, input, drag); ``disturb`` (name, number of those before) with the next step;
        ``release_control`` to the policy, unless the person still moves; ``proceed`` after a disturbance; ``show`` the
        newest frame again; ``save`` (outcome, reason of the stop), which ends the episode.
        """
        raise NotImplementedError

    def poll(self) -> bool:
        """Take what has come; return whether a step is done. EpisodeLost where the simulation has died."""
        raise NotImplementedError

    def recover(self) -> SavedEpisode | None:
        """Save the steps of an episode that was lost, as far as they are known; None where there are none."""
        raise NotImplementedError

    def discard(self) -> None:
        """End the episode and delete its steps; may be called twice."""
        raise NotImplementedError


class EpisodeLost(LayflatError):
    """The process of an episode ended by itself. The steps so far can still be saved."""


HandleFactory: TypeAlias = Callable[[int], EpisodeHandle]
"""Makes the episode of a seed; returns at once."""
