"""Reads rows of a demo's data sets as arrays."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import typed_attributes
from layflat.data.robot import RobotSpec


def default_rows(field: schema.Field, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return the rows that an absent data set stands for."""
    return np.full(shape, field.default, field.dtype)


def read_rows(group: h5py.Group, key: str, rows: slice = slice(None)) -> NDArray[Any]:
    """Return rows of a data set of a checked demo, or their default where it is absent."""
    field = schema.FIELDS[key]
    if key not in group:
        if field.default is None:
            raise DataError(f"{group.name} was recorded without {key}")
        return default_rows(field, (len(group[schema.PHASE]), *(schema.row_shape(field, _robot(group), {}) or ())))[
            rows
        ]
    found: NDArray[Any] = group[key][rows]
    if found.dtype.kind == "f" and key not in schema.MAY_BE_NAN and not np.isfinite(found).all():
        raise DataError(f"{group.name}/{key} holds a value that is not finite")
    return found


def demo_rows(group: h5py.Group, *, images: bool) -> dict[str, NDArray[Any]]:
    """Return all rows of a checked demo: N + 1 of each observation and ground truth field, N of each of STEP_FIELDS."""
    rows = {field.key: read_rows(group, field.key) for field in schema.STEP_FIELDS}
    for field in schema.OBSERVATION_FIELDS:
        key, following = f"{schema.OBS}/{field.key}", f"{schema.NEXT_OBS}/{field.key}"
        if not field.optional or (images and key in group):
            rows[field.key] = np.concatenate([group[key][()], group[following][-1:]])
    if schema.STATES in group:
        rows[schema.STATES] = np.concatenate([group[schema.STATES][()], group[schema.FINAL_STATE][()][np.newaxis]])
        rows |= {key: group[key][()] for key in (schema.CONTACT_TRUE, schema.FLAT_AREA)}
    return rows


def concatenated(
    keys: Sequence[str], lengths: Sequence[int], readers: Iterable[Callable[[str], NDArray[Any]]]
) -> dict[str, NDArray[Any]]:
    """Return the rows of episodes of these lengths one after another; each reader reads a key of one episode."""
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


def _robot(group: h5py.Group) -> RobotSpec:
    attributes = typed_attributes(group, {schema.ROBOT: str, schema.ACTION_AXES: str})
    return RobotSpec.from_json(str(attributes[schema.ROBOT]), str(attributes[schema.ACTION_AXES]))
