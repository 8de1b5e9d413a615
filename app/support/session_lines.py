"""Lines that recordings print about an episode, as scripts read them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from layflat.data.session.saved_episode import SavedEpisode

NAMED_MAX = 5
"""Copies that a sentence names one by one."""


def pairs_text(pairs: Mapping[str, str], word: str) -> str:
    """Return episodes with those that they belong to: "demo_5 of demo_0, demo_6 of demo_1 and 3 more"."""
    named = ", ".join(f"{name} {word} {first}" for name, first in list(pairs.items())[:NAMED_MAX])
    return named + (f" and {len(pairs) - NAMED_MAX} more" if len(pairs) > NAMED_MAX else "")


def names_text(names: Sequence[str]) -> str:
    """Return the first names and how many more there are: "demo_0, demo_1 and 3 more"."""
    return ", ".join(names[:NAMED_MAX]) + (f" and {len(names) - NAMED_MAX} more" if len(names) > NAMED_MAX else "")


def copies_text(copies: Mapping[str, str]) -> str:
    """Return how many episodes are copies, and of which: "one episode is a copy: demo_5 of demo_0"."""
    count = "one episode is a copy" if len(copies) == 1 else f"{len(copies)} episodes are copies"
    return f"{count}: {pairs_text(copies, 'of')}"


def copy_note(saved: SavedEpisode) -> str:
    """Return what to say of an episode whose content is in its session already."""
    return f"{saved.name} is a copy of {saved.copy_of} in {saved.path}: it is kept, and counts once in training"


def kept_line(saved: SavedEpisode) -> str:
    """Return the line of an episode that is durable in its session."""
    contact = min(1.0, saved.contact_final)
    return f"kept {saved.name} {saved.outcome} {saved.n_steps} steps contact {contact:.2f} {saved.path}"


def discarded_line(seed: int, n_steps: int, contact: float, path: Path) -> str:
    """Return the line of an episode that was discarded; it has no name in the session, so its seed stands there."""
    return f"discarded seed {seed} {n_steps} steps contact {min(1.0, contact):.2f} {path}"
