"""BenchmarkRow: a line of the table of `layflat bench`, made of measured wall times."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from layflat.data.arrays import FloatArray
from layflat.data.types import STEP_S

RTF = "sim s / wall s"
PER_STEP = "ms / step"
Samples: TypeAlias = Mapping[str, FloatArray]
"""Measured values by name, a value for each repeat or block."""


@dataclass(frozen=True, kw_only=True)
class BenchmarkRow:
    """One line of the table."""

    name: str
    value: float
    """Median of the repeats."""
    unit: str
    baseline: float | None = None
    """Value for comparison, in the same unit: a goal, bare substeps, or the default cloth."""
    samples: int = 1
    """Number of repeats or blocks."""

    @property
    def ratio(self) -> float | None:
        """Value / baseline."""
        return None if self.baseline is None else self.value / self.baseline


def real_time_row(name: str, step_wall_s: FloatArray, goal: float) -> BenchmarkRow:
    """Return simulated over wall time, from wall times of a step."""
    value = STEP_S / float(np.median(step_wall_s))
    return BenchmarkRow(name=name, value=value, unit=RTF, baseline=goal, samples=len(step_wall_s))


def wall_row(name: str, walls_s: FloatArray) -> BenchmarkRow:
    """Return a wall time in ms."""
    return BenchmarkRow(name=name, value=1e3 * float(np.median(walls_s)), unit="ms", samples=len(walls_s))


def comparison_row(name: str, ours_s: FloatArray, theirs_s: FloatArray, unit: str = PER_STEP) -> BenchmarkRow:
    """Return a wall time beside another one, in ms.

    The ratio is the median of those of neighbouring blocks, which a busy machine slows alike.
    """
    theirs = 1e3 * float(np.median(theirs_s))
    ratio = float(np.median(ours_s / theirs_s))
    return BenchmarkRow(name=name, value=theirs * ratio, unit=unit, baseline=theirs, samples=len(ours_s))


def speed_row(name: str, ours_s: FloatArray, theirs_s: FloatArray) -> BenchmarkRow:
    """Return simulated over wall time beside another one, from wall s per simulated s of neighbouring blocks."""
    theirs = 1 / float(np.median(theirs_s))
    ratio = float(np.median(theirs_s / ours_s))
    return BenchmarkRow(name=name, value=ratio * theirs, unit=RTF, baseline=theirs, samples=len(ours_s))
