"""What a session has so far."""

from __future__ import annotations

from pathlib import Path

from layflat.data.session.parts import part_files
from layflat.data.session.reader import open_session


def stored(path: Path) -> int:
    """How many episodes a session has, those included that are kept and not yet in the one file."""
    if not _exists(path):
        return 0
    with open_session(path) as session:
        return len(session)


def recorded_seeds(path: Path, source: str) -> frozenset[int]:
    """Seeds of which the session has whole episodes from this source: who records on begins with the next one."""
    if not _exists(path):
        return frozenset()
    with open_session(path) as session:
        infos = session.infos().values()
    return frozenset(info.seed for info in infos if info.source == source and info.outcome != "partial")


def _exists(path: Path) -> bool:
    return path.exists() or bool(part_files(path.resolve()))
