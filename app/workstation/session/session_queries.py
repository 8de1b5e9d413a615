"""Queries about a session that may not exist yet."""

from __future__ import annotations

from collections.abc import Collection
from itertools import count as count_up
from itertools import islice
from pathlib import Path

from layflat.app.support.formatting import ranges
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


def next_seeds(path: Path, source: str, count: int, first: int | None = None) -> tuple[list[int], list[int]]:
    """Return the next seeds that the session does not hold from this source, and those that are left out.

    They go up from ``first``, by default from the first seed that it holds, or from 0.
    """
    used = recorded_seeds(path, source)
    begin = max(min(used, default=0), 0) if first is None else first
    free = list(islice((seed for seed in count_up(begin) if seed not in used), count))
    return free, sorted(seed for seed in used if begin <= seed < free[-1])


def skipped_text(path: Path, skipped: Collection[int], seeds: Collection[int]) -> str:
    """Return what to say of seeds that are left out."""
    return f"{path} has {_seeds(skipped)} already; this records {_seeds(seeds)}"


def _seeds(seeds: Collection[int]) -> str:
    return f"seed{'s' * (len(seeds) > 1)} {ranges(seeds)}"


def _exists(path: Path) -> bool:
    return path.exists() or bool(part_files(path.resolve()))
