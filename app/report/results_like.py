"""Results of an evaluation, as its page reads them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import pandas as pd

from layflat.data.types import Episode


class ResultsLike(Protocol):
    """Rows and episodes of an evaluation."""

    @property
    def rows(self) -> pd.DataFrame:
        """The contract's columns, ``run`` (the name of an episode), and ``reason`` of a crash; one row per episode."""

    def episode(self, run: str, /) -> Episode:
        """Return the recorded episode of a row that did not crash."""


class ResultsFolder(ResultsLike, Protocol):
    """Results of an evaluation in a folder."""

    @property
    def folder(self) -> Path:
        """The evaluation's --out."""

    @property
    def summary(self) -> dict[str, Any]:
        """Content of summary.json; empty while the evaluation runs for the first time."""
