"""EvaluationResults: the folder of an evaluation, read back."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from layflat.app.evaluation.results_csv import ALL_COLUMNS
from layflat.app.support.metrics import COLUMNS
from layflat.app.workers.work_item import read_run
from layflat.data.errors import DataError
from layflat.data.types import Episode

CONFIG, EPISODES, SUMMARY, RUNS = "config.json", "episodes.csv", "summary.json", "runs"
_TEXTS = ("policy", "robot", "task", "cloth", "physics", "disturbance", "stopped_by", "run", "start", "reason")
_FLAGS = ("unstable", "crashed")
_COUNTS = ("seed", "steps", "attempts")
_NUMBERS = tuple(name for name in ALL_COLUMNS if name not in (*_TEXTS, *_FLAGS, *_COUNTS, "conditions"))


@dataclass(frozen=True)
class EvaluationResults:
    """The folder of an evaluation: rows of all episodes, the summary, and each episode by the name of its run."""

    folder: Path
    rows: pd.DataFrame
    """The shared columns, then ``run`` (the episode's name), ``start``, ``attempts``, ``reason`` (of a crash)."""
    summary: dict[str, Any]
    """As in summary.json; empty while the first evaluation in the folder runs."""
    config: dict[str, Any]
    """As in config.json: what was asked for."""

    @staticmethod
    def open(folder: str | Path) -> EvaluationResults:
        """Read the results of an evaluation, also while it runs or was interrupted; DataError where there are none."""
        folder = Path(folder)
        try:
            rows = read_rows(folder / EPISODES)
            config = json.loads((folder / CONFIG).read_text(encoding="utf-8"))
            path = folder / SUMMARY
            summary = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        except (OSError, ValueError) as error:
            raise DataError(f"{folder} does not hold the results of `layflat evaluate` ({error})") from error
        return EvaluationResults(folder, rows, summary, config)

    def episode(self, run: str) -> Episode:
        """Return the episode of a row, without images; DataError where it crashed."""
        return read_run(self.folder / RUNS, run)


def read_rows(path: Path) -> pd.DataFrame:
    """Read episodes.csv with the types of its columns; empty numbers are NaN."""
    rows = pd.read_csv(path, dtype=str, keep_default_na=False)
    # Numbers are read by Python: pandas' own way, before its version 3, may lose the last bit.
    numbers = {name: [float(cell) if cell else np.nan for cell in rows[name]] for name in _NUMBERS}
    flags = {name: rows[name] == "True" for name in _FLAGS}
    counts = {name: rows[name].astype(int) for name in _COUNTS}
    return rows.assign(**numbers, **flags, **counts, conditions=rows["conditions"].map(json.loads))


def as_rows(rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the shared columns as JSON values, None where an episode has no value."""
    plain = rows[list(COLUMNS)].astype(object)
    return list(plain.where(plain.notna(), None).to_dict(orient="records"))
