"""Statistics of a session, one episode in memory at a time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.format.schema import FIELDS, NEXT_OBS, STEP_KEYS
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
    contact_final_true: FloatArray
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
        contact_final_true=each("contact_final_true"),
        flat_area_final=each("flat_area_final"),
        columns=column_stats(session) if columns else {},
    )


def column_stats(session: Session) -> dict[str, ColumnStats]:
    """Return the statistics of all data sets with numbers per step, without images and ``next_obs``."""
    found: dict[str, ColumnStats] = {}
    for key in STEP_KEYS:
        field = FIELDS[key]
        if np.dtype(field.dtype).kind in "Si" or len(field.shape) == 4 or key.startswith(NEXT_OBS):
            continue
        # Of an optional data set that some episode has, the others count with its default, or not at all.
        having = [name for name in session.names if session.row_shape(name, key) is not None]
        for name in session.names if having and field.default is not None else having:
            rows = session.array(name, key).astype(float)
            stats = _stats_of(rows.reshape(len(rows), -1), field.unit)
            found[key] = _merged(found[key], stats) if key in found else stats
    return found


def _stats_of(rows: FloatArray, unit: str) -> ColumnStats:
    """Return the statistics of rows (N, D); rows with NaN have no value and are left out."""
    rows = rows[~np.isnan(rows).any(axis=1)]
    if not len(rows):
        return ColumnStats(unit=unit, count=0, **dict.fromkeys(("min", "max", "mean", "std"), np.zeros(0)))
    low, high = rows.min(axis=0), rows.max(axis=0)
    return ColumnStats(unit=unit, count=len(rows), min=low, max=high, mean=rows.mean(axis=0), std=rows.std(axis=0))


def _merged(a: ColumnStats, b: ColumnStats) -> ColumnStats:
    """Return the statistics of the rows of both (Chan's update of mean and squared deviations)."""
    if not a.count or not b.count:
        return a if a.count else b
    count, apart = a.count + b.count, b.mean - a.mean
    squares = a.std**2 * a.count + b.std**2 * b.count + apart**2 * (a.count * b.count / count)
    return ColumnStats(
        unit=a.unit,
        count=count,
        min=np.minimum(a.min, b.min),
        max=np.maximum(a.max, b.max),
        mean=a.mean + apart * (b.count / count),
        std=np.sqrt(squares / count),
    )
