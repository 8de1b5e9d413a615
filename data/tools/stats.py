"""Statistics of a session, one episode in memory at a time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.format.schema import DEPTH, NEXT_OBS, RGB
from layflat.data.session.reader import Session
from layflat.data.session.row_arrays import PER_STEP


@dataclass(frozen=True, kw_only=True)
class ColumnStats:
    """Of one data set, over all steps of all episodes; each array has one value per column."""

    unit: str
    count: int
    minimum: FloatArray
    maximum: FloatArray
    mean: FloatArray
    std: FloatArray
    """Of the population (divided by count)."""


@dataclass(frozen=True, kw_only=True)
class SessionStats:
    """What a session holds, in numbers."""

    episodes: int
    n_steps: int
    outcomes: Mapping[str, int]
    sources: Mapping[str, int]
    disturbances: Mapping[str, int]
    lengths: FloatArray
    """(E,) steps of each episode, in the order of their names; so are the following."""
    contact_start: FloatArray
    contact_final: FloatArray
    contact_true_final: FloatArray
    flat_area_final: FloatArray
    columns: Mapping[str, ColumnStats]
    """By data set: those with numbers per step, without images and ``next_obs``."""


def session_stats(session: Session, *, columns: bool = True) -> SessionStats:
    """Reads every episode, unless ``columns`` is False."""
    infos = list(session.infos().values())

    def each(name: str) -> FloatArray:
        return np.array([getattr(info, name) for info in infos], dtype=float)

    return SessionStats(
        episodes=len(infos),
        n_steps=sum(info.n_steps for info in infos),
        outcomes=Counter(info.outcome for info in infos),
        sources=Counter(info.source for info in infos),
        disturbances=Counter(info.disturbance for info in infos),
        lengths=each("steps"),
        contact_start=each("contact_start"),
        contact_final=each("contact_final"),
        contact_true_final=each("contact_true_final"),
        flat_area_final=each("flat_area_final"),
        columns=column_stats(session) if columns else {},
    )


def column_stats(session: Session) -> dict[str, ColumnStats]:
    """Of all data sets that have numbers per step, without images and ``next_obs``."""
    running: dict[str, _Running] = {}
    for key, field in PER_STEP.items():
        if np.dtype(field.dtype).kind in "Si" or key.startswith(NEXT_OBS) or key.endswith((f"/{RGB}", f"/{DEPTH}")):
            continue
        if field.absent is not None and not any(key in session.group(name) for name in session.names):
            continue
        for name in session.names:
            rows = session.array(name, key).astype(float)
            running.setdefault(key, _Running(field.unit)).add(rows.reshape(len(rows), -1))
    return {key: value.result() for key, value in running.items()}


class _Running:
    """Chan's update of mean and squared deviations, batch by batch; NaN (no confidence given) is left out."""

    def __init__(self, unit: str) -> None:
        self.unit = unit
        self.count = 0
        self.minimum = self.maximum = self.mean = self.squares = np.zeros(0)

    def add(self, rows: FloatArray) -> None:
        rows = rows[~np.isnan(rows).any(axis=1)]
        if not len(rows):
            return
        mean = rows.mean(axis=0)
        squares = ((rows - mean) ** 2).sum(axis=0)
        if not self.count:
            self.minimum, self.maximum = rows.min(axis=0), rows.max(axis=0)
            self.mean, self.squares, self.count = mean, squares, len(rows)
            return
        total, apart = self.count + len(rows), mean - self.mean
        self.squares = self.squares + squares + apart**2 * (self.count * len(rows) / total)
        self.mean = self.mean + apart * (len(rows) / total)
        self.minimum = np.minimum(self.minimum, rows.min(axis=0))
        self.maximum = np.maximum(self.maximum, rows.max(axis=0))
        self.count = total

    def result(self) -> ColumnStats:
        return ColumnStats(
            unit=self.unit,
            count=self.count,
            minimum=self.minimum,
            maximum=self.maximum,
            mean=self.mean,
            std=np.sqrt(self.squares / max(self.count, 1)),
        )
