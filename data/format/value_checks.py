"""Checks the values of a demo's arrays, read in blocks so that memory stays small for any file."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.demo_info import DemoInfo
from layflat.data.format.structure_checks import Violations
from layflat.data.types import PHASES

BLOCK_BYTES = 1 << 24
UNIT_TOLERANCE = 1e-6
CONTACT_MAX = 1.5
"""Noise may take the camera's contact portion above 1, but not far."""
RANGES = {
    schema.ACTIONS: (-1.0, 1.0),
    schema.ACTION_STD: (0.0, np.inf),
    schema.CONTACT_TRUE: (0.0, 1.0),
    schema.FLAT_AREA: (-2.0, 2.0),
    "word": (-1.0 - UNIT_TOLERANCE, 1.0 + UNIT_TOLERANCE),
    "word_strength": (0.0, np.inf),
    "contact_portion": (0.0, CONTACT_MAX),
    schema.INTERVENTION: (0, 1),
    schema.DEPTH: (0.0, np.inf),
}
"""Least and greatest value by data set, or by its name under ``obs`` and ``next_obs``."""


def inspect_contents(group: h5py.Group, info: DemoInfo, found: Violations) -> None:
    """Add to ``found`` what is wrong with the values of a demo that has passed check_demo."""
    before = len(found)
    for field in schema.FIELDS.values():
        if field.key in group:
            with found.at(f"{group.name}/{field.key}"):
                _check_values(group[field.key], field)
    if len(found) > before:
        return
    for key, check in (
        (schema.DONES, _check_dones),
        (schema.REWARDS, _check_rewards),
        ("obs/word", _check_unit),
        ("obs/time_s", partial(_check_time, unstable=info.stopped_by == "unstable")),
        (schema.DRAG_NODE, _check_drags),
    ):
        with found.at(f"{group.name}/{key}"):
            check(group)
    for field in schema.OBSERVATION_FIELDS:
        if f"{schema.OBS}/{field.key}" in group:
            with found.at(f"{group.name}/{schema.NEXT_OBS}/{field.key}"):
                _check_next(group, field.key)


def _blocks(dataset: h5py.Dataset) -> Iterator[tuple[int, NDArray[Any]]]:
    """Yield the number of a first row and rows from there, a few megabytes at a time."""
    if not dataset.size:
        return
    per_row = max(1, dataset.dtype.itemsize * dataset.size // len(dataset))
    step = max(1, BLOCK_BYTES // per_row)
    for start in range(0, len(dataset), step):
        yield start, dataset[start : start + step]


def _check_values(dataset: h5py.Dataset, field: schema.Field) -> None:
    low, high = RANGES.get(field.key, RANGES.get(field.key.rpartition("/")[2], (-np.inf, np.inf)))
    for start, rows in _blocks(dataset):
        if rows.dtype.kind == "S":
            _all(np.isin(rows, [phase.encode() for phase in PHASES]), start, rows, f"one of {', '.join(PHASES)}")
            continue
        if field.key in schema.MAY_BE_NAN:
            absent = np.isnan(rows).all(axis=tuple(range(1, rows.ndim)), keepdims=True)
            rows = np.where(absent, 0.0, rows)
        _all(np.isfinite(rows), start, rows, "finite")
        _all((rows >= low) & (rows <= high), start, rows, f"within {low:g} to {high:g}")


def _all(fine: NDArray[np.bool_], start: int, rows: NDArray[Any], right: str) -> None:
    if not fine.all():
        where = tuple(int(i) for i in np.argwhere(~fine)[0])
        shown = rows[where]
        raise DataError(f"row {start + where[0]} holds {shown}; it must be {right}")


def _check_dones(group: h5py.Group) -> None:
    dones = group[schema.DONES][()]
    if dones[:-1].any() or dones[-1] != 1:
        raise DataError("must be 1 on the last step and 0 before")


def _check_rewards(group: h5py.Group) -> None:
    gained = group["next_obs/contact_portion"][:, 0] - group["obs/contact_portion"][:, 0]
    if not np.allclose(group[schema.REWARDS][()], gained, rtol=0, atol=1e-9):
        raise DataError("is not what the contact portion gains in each step")


def _check_unit(group: h5py.Group) -> None:
    length = np.linalg.norm(group["obs/word"][()], axis=1)
    wrong = np.flatnonzero((length > UNIT_TOLERANCE) & (abs(length - 1) > UNIT_TOLERANCE))
    if wrong.size:
        raise DataError(f"row {wrong[0]} is of length {length[wrong[0]]:.6g}; it must be 1, or 0 without a direction")


def _check_time(group: h5py.Group, *, unstable: bool) -> None:
    """Time rises; the last step of a diverged simulation may repeat the observation before it."""
    time = np.append(group["obs/time_s"][:, 0], group["next_obs/time_s"][-1:, 0])
    passed = np.diff(time)
    back = np.flatnonzero((passed < 0) | ((passed == 0) & ~(unstable & (np.arange(len(passed)) == len(passed) - 1))))
    if back.size:
        raise DataError(f"does not rise after step {back[0]}")


def _check_drags(group: h5py.Group) -> None:
    if (schema.DRAG_NODE in group) != (schema.DRAG_TARGET in group):
        raise DataError(f"there must be {schema.DRAG_NODE} and {schema.DRAG_TARGET}, or neither")
    if schema.DRAG_NODE not in group:
        return
    nodes = group[schema.DRAG_NODE][()]
    # Without ground truth the number of nodes is not known.
    count = group[schema.STATES].shape[1] // 3 if schema.STATES in group else np.inf
    wrong = np.flatnonzero((nodes < -1) | (nodes >= count))
    if wrong.size:
        raise DataError(f"row {wrong[0]} is node {nodes[wrong[0]]} of {count}; it must be one of them, or -1")
    unlike = np.flatnonzero((nodes < 0) != np.isnan(group[schema.DRAG_TARGET][()]).any(axis=1))
    if unlike.size:
        raise DataError(f"row {unlike[0]} has a node without a target, or a target without a node")


def _check_next(group: h5py.Group, key: str) -> None:
    now, following = group[f"{schema.OBS}/{key}"], group[f"{schema.NEXT_OBS}/{key}"]
    for start, rows in _blocks(following):
        rows = rows[: len(now) - 1 - start]
        if not np.array_equal(rows, now[start + 1 : start + 1 + len(rows)]):
            raise DataError(f"is not {schema.OBS}/{key} of the following step")
