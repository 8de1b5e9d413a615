"""What a batch leaves in its folder, read back."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from data.types import Episode


@dataclass(frozen=True)
class Results:
    """A batch's folder: ``rows`` of all episodes, the ``summary``, and each episode by its run's name."""

    folder: Path
    rows: pd.DataFrame
    """The contract's columns, then ``run`` (the episode's name), ``start``, ``attempts`` and ``reason`` (of a crash)."""
    summary: dict[str, Any]
    """As in summary.json."""
    batch: dict[str, Any]
    """As in batch.json: what was asked."""

    @staticmethod
    def open(folder: str | Path) -> Results:
        """The results in ``folder``, of a batch that runs, was interrupted or is finished; DataError where there are none."""
        raise NotImplementedError

    def episode(self, run: str) -> Episode:
        """The episode of a row, without images; DataError where it crashed."""
        raise NotImplementedError
