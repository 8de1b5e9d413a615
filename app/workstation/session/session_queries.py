"""Queries about a session that may not exist yet."""

from __future__ import annotations

from pathlib import Path

from layflat.data.session.parts import part_files
from layflat.data.session.reader import open_session


def n_episodes(path: Path) -> int:
    """Return the number of episodes, including those that are not yet in the one file."""
    if not _exists(path):
        return 0
    with open_session(path) as session:
        return len(session)


def recorded_seeds(path: Path, source: str) -> frozenset[int]:
    """Return the seeds of whole episodes from this source, which a further recording leaves out."""
    if not _exists(path):
        return frozenset()
    with open_session(path) as session:
        infos = session.infos().values()
    return frozenset(info.seed for info in infos if info.source == source and info.outcome != "partial")


def _exists(path: Path) -> bool:
    return path.exists() or bool(part_files(path.resolve()))
