"""SavedEpisode: where a durable episode is found."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from layflat.data.types import Outcome


@dataclass(frozen=True, kw_only=True)
class SavedEpisode:
    """Where a durable episode is found."""

    name: str
    """demo_<int>: its name in the session."""
    path: Path
    """The session's file."""
    n_steps: int
    size_bytes: int
    outcome: Outcome
    contact_final: float
    step_s: float
    descriptor: str
