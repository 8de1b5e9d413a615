"""Runs a plan into a folder, from where an earlier run stopped."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, TypeAlias

from app.batch.plan import Plan
from app.batch.results import Results
from app.progress import Progress

EngineName: TypeAlias = Literal["local", "ray"]


def run_batch(
    plan: Plan,
    out: Path,
    *,
    workers: int,
    engine: EngineName = "local",
    address: str | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> Results:
    """Run what ``out`` does not hold yet of ``plan``; episodes that crash are rows, not errors.

    ``progress`` is in a phase whose items are the plan's episodes; without one there is no progress. KeyboardInterrupt
    comes when everything that is finished has been kept. WrongCall where ``out`` holds another batch.
    """
    raise NotImplementedError
