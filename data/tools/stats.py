"""Statistics of a session, one episode in memory at a time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.format.schema import DEPTH, FIELDS, NEXT_OBS, RGB, STEP_KEYS
from layflat.data.session.reader import Session


@dataclass(frozen=True, kw_only=True)
class ColumnStats:
    """Statistics of one data set over all steps of all episodes; each array has one value per column."""

    unit: str
    count: int
    min: FloatArray
    max: FloatArray
    mean: FloatArray
    std: FloatArray
    """Standard deviation of the population (divided by count)."""


@dataclass(frozen=True, kw_only=True)
class SessionStats:
    """Statistics of a session."""

    episodes: int
    n_steps: int
    outcomes: Mapping[str, int]
    sources: Mapping[str, int]
    disturbances: Mapping[str, int]
    lengths: FloatArray
    """(E,) number of steps of each episode, in the order of their names, as all that follow."""
    contact_start: FloatArray
    contact_final: FloatArray
    contact_true_final: FloatArray
    """NaN for an episode without ground truth."""
    flat_area_final: FloatArray
    """NaN for an episode without ground truth."""
    columns: Mapping[str, ColumnStats]
    """Statistics by data set, of those with numbers per step, without images and ``next_obs``."""


def session_stats(session: Session, *, columns: bool = True) -> SessionStats:
    """Return the statistics of a session; every episode is read, unless ``columns`` is False."""
    infos = list(session.infos().values())

    def each(name: str) -> FloatArray:
        return np.array([getattr(info, name) for info in infos], dtype=float)

    return SessionStats(
        episodes=len(infos),
        n_steps=sum(info.n_steps for info in infos),
        outcomes=Counter(info.outcome for info in infos),
        sources=Counter(info.source for info in infos),
        disturbances=Counter(info.disturbance for info in infos),
        lengths=each("n_steps"),
        contact_start=each("contact_start"),
        contact_final=each("contact_final"),
        contact_true_final=each("contact_true_final"),
        flat_area_final=each("flat_area_final"),
        columns=column_stats(session) if columns else {},
    )


def column_stats(session: Session) -> dict[str, ColumnStats]:
    """Return the statistics of all data sets with numbers per step, without images and ``next_obs``."""
    running: dict[str, _Running] = {}
    for key in STEP_KEYS:
        field = FIELDS[key]
        if np.dtype(field.dtype).kind in "Si" or key.startswith(NEXT_OBS) or key.endswith((f"/{RGB}", f"/{DEPTH}")):
            continue
        # Of an optional data set that some episode has, the others count with its default, or not at all.
        having = [name for name in session.names if key in session.group(name)]
        for name in session.names if having and field.default is not None else having:
            rows = session.array(name, key).astype(float)
            running.setdefault(key, _Running(field.unit)).add(rows.reshape(len(rows), -1))
    return {key: value.result() for key, value in running.items()}


class _Running:
    """Chan's update of mean and squared deviations, batch by batch; rows with NaN (no value) are left out."""

    def __init__(self, unit: str) -> None:
        self.unit = unit
        self.count = 0
        self.min = self.max = self.mean = self.squares = np.zeros(0)

    def add(self, rows: FloatArray) -> None:
        rows = rows[~np.isnan(rows).any(axis=1)]
        if not len(rows):
            return
        mean = rows.mean(axis=0)
        squares = ((rows - mean) ** 2).sum(axis=0)
        if not self.count:
            self.min, self.max = rows.min(axis=0), rows.max(axis=0)
            self.mean, self.squares, self.count = mean, squares, len(rows)
            return
        total, apart = self.count + len(rows), mean - self.mean
        self.squares = self.squares + squares + apart**2 * (self.count * len(rows) / total)
        self.mean = self.mean + apart * (len(rows) / total)
        self.min = np.minimum(self.min, rows.min(axis=0))
        self.max = np.maximum(self.max, rows.max(axis=0))
        self.count = total

    def result(self) -> ColumnStats:
        return ColumnStats(
            unit=self.unit,
            count=self.count,
            min=self.min,
            max=self.max,
            mean=self.mean,
            std=np.sqrt(self.squares / max(self.count, 1)),
        )
