"""Statistics that LeRobot normalises by: minimum, maximum, mean, standard deviation, quantiles and count."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
DEPTH_BIN_M = 0.001
_BYTE_BINS, _DEPTH_BINS = 256, 1 << 16


class Stats:
    """Statistics of all rows that were added: exact for numbers and rgb, to a millimetre for depth."""

    def __init__(self) -> None:
        self._rows: dict[str, list[NDArray[np.float64]]] = {}
        self._bins: dict[str, NDArray[np.int64]] = {}
        self._images: dict[str, int] = {}

    def add(self, columns: Mapping[str, NDArray[Any]]) -> None:
        """Add columns by key: numbers (T,) or (T, D), images (T, H, W, C) uint8 or float32 metres."""
        for key, rows in columns.items():
            if rows.ndim == 4:
                self._images[key] = self._images.get(key, 0) + len(rows)
                bins = np.array([_histogram(rows[..., channel]) for channel in range(rows.shape[3])])
                self._bins[key] = self._bins[key] + bins if key in self._bins else bins
            else:
                values = rows.astype(np.float64).reshape(len(rows), -1)
                self._rows.setdefault(key, []).append(values)

    def merge(self, other: Stats) -> None:
        """Add the rows of other statistics."""
        for key, rows in other._rows.items():
            self._rows.setdefault(key, []).extend(rows)
        for key, bins in other._bins.items():
            self._bins[key] = self._bins[key] + bins if key in self._bins else bins
            self._images[key] = self._images.get(key, 0) + other._images[key]

    def result(self) -> dict[str, dict[str, Any]]:
        """Return feature -> statistic -> value as in JSON: lists of one number for each component or channel."""
        numbers = {key: _of_numbers(np.concatenate(rows)) for key, rows in self._rows.items()}
        return numbers | {key: _of_bins(bins, self._images[key]) for key, bins in self._bins.items()}


def _of_numbers(values: NDArray[np.float64]) -> dict[str, Any]:
    found = {
        "min": values.min(axis=0),
        "max": values.max(axis=0),
        "mean": values.mean(axis=0),
        "std": values.std(axis=0),
    }
    found |= {name: np.quantile(values, share, axis=0) for name, share in QUANTILES.items()}
    return {**{name: value.tolist() for name, value in found.items()}, "count": [len(values)]}


def _histogram(channel: NDArray[Any]) -> NDArray[np.int64]:
    if channel.dtype == np.uint8:
        return np.bincount(channel.ravel(), minlength=_BYTE_BINS)
    millimetres = np.clip(np.rint(channel.ravel() / DEPTH_BIN_M), 0, _DEPTH_BINS - 1).astype(np.int64)
    return np.bincount(millimetres, minlength=_DEPTH_BINS)


def _of_bins(bins: NDArray[np.int64], images: int) -> dict[str, Any]:
    """Return values per channel as (C, 1, 1), which LeRobot broadcasts over an image; rgb in 0..1, depth in metres."""
    scale = 1.0 / 255.0 if bins.shape[1] == _BYTE_BINS else DEPTH_BIN_M
    values = scale * np.arange(bins.shape[1])
    found: dict[str, list[Any]] = {name: [] for name in ("min", "max", "mean", "std", *QUANTILES)}
    for counts in bins:
        shares = counts / counts.sum()
        there = np.flatnonzero(counts)
        mean = float(shares @ values)
        summed = np.cumsum(shares)
        one = {"min": values[there[0]], "max": values[there[-1]], "mean": mean}
        one["std"] = np.sqrt(shares @ (values - mean) ** 2)
        one |= {name: values[np.searchsorted(summed, share)] for name, share in QUANTILES.items()}
        for name, value in one.items():
            found[name].append([[float(value)]])
    return {**found, "count": [images]}
