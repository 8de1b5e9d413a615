"""Lines that recordings print about an episode, as scripts read them."""

from __future__ import annotations

from pathlib import Path

from layflat.data.session.saved_episode import SavedEpisode


def kept_line(saved: SavedEpisode) -> str:
    """Return the line of an episode that is durable in its session."""
    contact = min(1.0, saved.contact_final)
    return f"kept {saved.name} {saved.outcome} {saved.n_steps} steps contact {contact:.2f} {saved.path}"


def discarded_line(seed: int, n_steps: int, contact: float, path: Path) -> str:
    """Return the line of an episode that was discarded; it has no name in the session, so its seed stands there."""
    return f"discarded seed {seed} {n_steps} steps contact {min(1.0, contact):.2f} {path}"
