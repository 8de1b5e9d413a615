"""Rows of data sets as arrays, without making episodes of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from layflat.data.errors import DataError
from layflat.data.format import schema

PER_STEP = {field.key: field for field in schema.FIELDS if field.shape[0] == "N"}
"""Data sets with one row per step."""
MAY_BE_UNKNOWN = (schema.ACTION_STD, schema.PULL_TARGET, schema.HAND)
"""NaN there says that there is none."""


def read_rows(group: h5py.Group, key: str, n_steps: slice) -> NDArray[Any]:
    """Rows ``steps`` of a data set of a checked demo; all of it where it has no row per step."""
    field = next((field for field in schema.FIELDS if field.key == key), None)
    if field is None:
        raise DataError(
            f"{key!r} is no data set of an episode; known ones are {', '.join(f.key for f in schema.FIELDS)}"
        )
    if key not in group and field.absent is not None:
        shape = (len(group[schema.PHASE]), *(n for n in field.shape[1:] if isinstance(n, int)))
        return np.full(shape, field.absent, field.dtype)[n_steps]
    if key not in group:
        raise DataError(f"{group.name} was recorded without {key}")
    rows: NDArray[Any] = group[key][n_steps]
    if rows.dtype.kind == "f" and key not in MAY_BE_UNKNOWN and not np.isfinite(rows).all():
        raise DataError(f"{group.name}/{key} holds a value that is not finite")
    return rows


def stacked(
    keys: Sequence[str], lengths: Sequence[int], readers: Iterable[Callable[[str], NDArray[Any]]]
) -> dict[str, NDArray[Any]]:
    """Rows of episodes of these lengths one after another; ``readers`` read a key of one episode each."""
    for key in keys:
        if key not in PER_STEP:
            raise DataError(f"{key!r} has no row per step; those that have are {', '.join(PER_STEP)}")
    found: dict[str, NDArray[Any]] = {
        "episode": np.repeat(np.arange(len(lengths)), lengths),
        "step": np.concatenate([np.arange(length) for length in lengths] or [np.zeros(0, int)]),
    }
    start = 0
    for length, read in zip(lengths, readers, strict=True):
        for key in keys:
            rows = read(key)
            if key not in found:
                found[key] = np.empty((len(found["step"]), *rows.shape[1:]), rows.dtype)
            whole = found[key]
            if whole.shape[1:] != rows.shape[1:]:
                raise DataError(f"{key} has rows of {rows.shape[1:]} here and of {whole.shape[1:]} in others")
            whole[start : start + length] = rows
        start += length
    return found
