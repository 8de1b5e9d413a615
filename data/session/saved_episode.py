"""SavedEpisode: report of an episode that is durable, and saving one as a part of its session."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from layflat.data.atomic_files import fsync_write
from layflat.data.format.attributes import Attribute
from layflat.data.format.content import content_of_episode
from layflat.data.format.encode import shared_attributes
from layflat.data.session.reader import open_session
from layflat.data.session.session_writer import serialize, write_errors
from layflat.data.types import Episode, Outcome


@dataclass(frozen=True, kw_only=True)
class SavedEpisode:
    """Report of an episode that is durable."""

    name: str
    """demo_<int>, its name in the session."""
    path: Path
    """The session's file."""
    uid: str
    n_steps: int
    size_bytes: int
    outcome: Outcome
    contact_final: float
    shared: Mapping[str, Attribute]
    """Attributes that all episodes of the session share."""
    content: str
    """Digest of its content, see `layflat.data.format.content`."""
    copy_of: str | None = None
    """Name of an earlier episode of the session with the same content."""


def save_part(session: Path, parts: Path, name: str, episode: Episode, uid: str, *, save_images: bool) -> SavedEpisode:
    """Save an episode durably as a file of its own in the session's folder of parts; WriteError where that fails."""
    image = serialize(name, episode, uid, save_images=save_images)
    with write_errors(session):
        fsync_write(parts / f"{name}.h5", image)
    return SavedEpisode(
        name=name,
        path=session,
        uid=uid,
        n_steps=len(episode.steps),
        size_bytes=len(image),
        outcome=episode.outcome,
        contact_final=episode.final_observation.contact_portion,
        shared=shared_attributes(episode),
        content=content_of_episode(episode),
    )


def saved_in(part: Path, name: str, session: Path) -> SavedEpisode:
    """Return the report of an episode from its file in the session's folder of parts."""
    with open_session(part, edits=False) as opened:
        info, shared, content = opened.info(name), opened.shared, opened.contents((name,))[name]
    return SavedEpisode(
        name=name,
        path=session,
        uid=info.uid,
        n_steps=info.n_steps,
        size_bytes=part.stat().st_size,
        outcome=info.outcome,
        contact_final=info.contact_final,
        shared=shared,
        content=content,
    )
