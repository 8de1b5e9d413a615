"""Back from robomimic's form: episodes of a file in our layout that another tool has written or changed.

Such a tool may have dropped attributes that it does not know, converted numbers, packed data sets anew, or left out
what is optional. What an episode cannot do without must be there: actions, ``obs``, ``next_obs``, ``states`` and
``truth``. What only an attribute told is taken from the file where it is, and is otherwise marked as unknown.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any, cast

import h5py
import numpy as np
from numpy.typing import NDArray

from data import schema
from data.decode import EXPANSION_MAX, check_hard_links
from data.types import (
    ACTION_LIMIT_M,
    FLAT_AREA,
    OUTCOMES,
    STOPS,
    TASKS,
    TICK_S,
    DataError,
    Episode,
    Observation,
    Outcome,
    Phase,
    Provenance,
    Step,
    StoppedBy,
    Task,
    Truth,
    action_size,
)

UNKNOWN_SEED = -1
"""Of an episode whose file does not tell: it can be shown and learned from, but its start cannot be made again."""
UNKNOWN_SOURCE = "imported"


@dataclass(frozen=True, kw_only=True)
class Told:
    """What the file says about an episode beside its arrays, with what stands in where it says nothing."""

    attributes: Mapping[str, Any]
    """Of the demo, over those of /data, over env_args."""

    def text(self, key: str, default: str) -> str:
        value = self.attributes.get(key, default)
        return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)

    def number(self, key: str, default: float) -> float:
        value = self.attributes.get(key, default)
        if isinstance(value, (bool, int, float, np.number)):
            return float(value)
        raise DataError(f"attribute {key} is {value!r}; it must be a number")

    def mapping(self, key: str) -> dict[str, Any]:
        """A JSON object; empty where there is none."""
        try:
            value = json.loads(self.text(key, "{}"))
        except ValueError:
            value = None
        if not isinstance(value, dict):
            raise DataError(f"attribute {key} is {self.text(key, '')!r}; it must be a JSON object")
        return value


def imported_episode(group: h5py.Group, *, file: Path, cloth: str | None, images: bool = True) -> Episode:
    """The episode of one demo of a foreign file; DataError in one sentence where it cannot be one.

    ``cloth`` is taken where the file names none.
    """
    check_hard_links(group)
    told = _told(group)
    rows = _Rows(group)
    actions = rows.take(schema.ACTIONS, ndim=2)
    task = _task(told, actions)
    if len(actions) < 1 or actions.shape[1] != action_size(task):
        raise DataError(f"{group.name}/{schema.ACTIONS} has shape {actions.shape}; task {task} has {action_size(task)}")
    observations = _observations(rows, len(actions), images=images)
    truths = _truths(rows, len(actions))
    tick_s = told.number(schema.TICK_S, _tick_s(observations))
    return Episode(
        task=task,
        cloth=_cloth(told, cloth),
        seed=int(told.number(schema.SEED, UNKNOWN_SEED)),
        source=told.text(schema.SOURCE, UNKNOWN_SOURCE),
        steps=_steps(rows, actions, observations, truths),
        final_observation=observations[-1],
        final_truth=truths[-1],
        stopped_by=_stopped_by(told),
        outcome=_outcome(told, truths[-1]),
        tick_s=tick_s,
        disturbance=told.text(schema.DISTURBANCE, "none"),
        wall_s=told.number(schema.WALL_S, 0.0),
        start={key: float(value) for key, value in told.mapping(schema.START).items()},
        provenance=_provenance(told, file),
    )


def _told(group: h5py.Group) -> Told:
    data = group.parent
    found: dict[str, Any] = {}
    env = Told(attributes=dict(data.attrs)).mapping(schema.ENV_ARGS)
    kwargs = env.get("env_kwargs")
    if isinstance(kwargs, dict) and "cloth" in kwargs:
        found[schema.CLOTH] = kwargs["cloth"]
    for task, name in schema.ENV_NAMES.items():
        if env.get("env_name") == name:
            found[schema.TASK] = task
    for attributes in (data.attrs, group.attrs):
        for key in attributes:
            value = attributes[key]
            found[key] = value.item() if isinstance(value, np.generic) else value
    return Told(attributes=found)


def _task(told: Told, actions: NDArray[np.float64]) -> Task:
    by_width = {action_size(task): task for task in TASKS}
    task = told.text(schema.TASK, by_width.get(actions.shape[1], "unknown"))
    if task not in TASKS:
        raise DataError(
            f"the task is {task!r} and an action has {actions.shape[1]} components; tasks are {', '.join(TASKS)}"
        )
    return task


def _cloth(told: Told, given: str | None) -> str:
    cloth = told.text(schema.CLOTH, given or "")
    if not cloth:
        raise DataError("no cloth is named; say which one it was")
    return cloth


def _stopped_by(told: Told) -> StoppedBy:
    value = told.text(schema.STOPPED_BY, "tick_limit")
    if value not in STOPS:
        raise DataError(f"attribute {schema.STOPPED_BY} is {value!r}; it must be one of {', '.join(STOPS)}")
    return value


def _outcome(told: Told, final: Truth) -> Outcome:
    """By what the recorder goes by, where the file does not say it."""
    value = told.text(schema.OUTCOME, "success" if final.flat_area > FLAT_AREA else "failure")
    if value not in OUTCOMES:
        raise DataError(f"attribute {schema.OUTCOME} is {value!r}; it must be one of {', '.join(OUTCOMES)}")
    return value


def _tick_s(observations: list[Observation]) -> float:
    """From the times that were recorded; all ticks are as long as the first, or it is the usual length."""
    steps = np.diff([observation.time_s for observation in observations])
    even = steps.min() > 0 and np.allclose(steps, steps[0], rtol=1e-4)
    return float(np.round(steps.mean(), 6)) if even else TICK_S


def _provenance(told: Told, file: Path) -> Provenance:
    value = told.mapping(schema.PROVENANCE)
    versions = value.get("versions")
    return Provenance(
        versions={str(k): str(v) for k, v in versions.items()} if isinstance(versions, dict) else {},
        platform=str(value.get("platform", "")),
        created_utc=str(value.get("created_utc", "")),
        command=str(value.get("command", f"imported from {file.name}")),
    )


class _Rows:
    """Data sets of a demo, read after a look at what they claim."""

    def __init__(self, group: h5py.Group) -> None:
        self._group = group
        self._file_bytes = group.file.id.get_filesize()

    def has(self, key: str) -> bool:
        return key in self._group

    def take(self, key: str, *, ndim: int, dtype: str = "<f8") -> NDArray[Any]:
        """The whole data set as ``dtype``; it may be stored otherwise, but must be numbers (or bytes for bytes)."""
        name = f"{self._group.name}/{key}"
        for parent in (part for part in (key.rpartition("/")[0],) if part):
            if not isinstance(self._group.get(parent), h5py.Group):
                raise DataError(f"{self._group.name} has no group {parent}; an episode needs it")
            check_hard_links(self._group[parent])
        dataset = self._group.get(key)
        if not isinstance(dataset, h5py.Dataset):
            raise DataError(f"{self._group.name} has no data set {key}; an episode needs it")
        if dataset.is_virtual or dataset.external:
            raise DataError(f"{name} keeps its data in another file; it must hold its data itself")
        if dataset.dtype.kind not in ("S" if dtype[1] == "S" else "fiub"):
            raise DataError(f"{name} is of type {dataset.dtype}; it must be convertible to {np.dtype(dtype)}")
        if dataset.shape is None or dataset.ndim != ndim:
            raise DataError(f"{name} has shape {dataset.shape}; it must have {ndim} dimensions")
        claimed, stored = prod(dataset.shape) * dataset.dtype.itemsize, dataset.id.get_storage_size()
        if stored > self._file_bytes or claimed > stored * EXPANSION_MAX:
            raise DataError(f"{name} claims {claimed} bytes of which the file holds {stored}")
        return np.asarray(dataset[()]).astype(dtype)


def _observations(rows: _Rows, count: int, *, images: bool) -> list[Observation]:
    """All count + 1, from ``obs`` and the last row of ``next_obs``."""
    found: dict[str, NDArray[Any]] = {}
    for field in schema.OBSERVATION_FIELDS:
        key, after = f"{schema.OBS}/{field.key}", f"{schema.NEXT_OBS}/{field.key}"
        if field.optional and not (images and rows.has(key) and rows.has(after)):
            continue
        before = rows.take(key, ndim=len(field.shape), dtype=field.dtype)
        later = rows.take(after, ndim=len(field.shape), dtype=field.dtype)
        if len(before) != count or later.shape != before.shape:
            raise DataError(f"{key} and {after} have {len(before)} and {len(later)} rows; there are {count} actions")
        if not np.array_equal(before[1:], later[:-1]):
            raise DataError(f"{after} is not {key} one tick later; an episode is one unbroken series")
        found[field.key] = np.concatenate([before, later[-1:]])
    for key, width in (("corner_positions", 6), ("holder_position", 3), ("word", 2)):
        if found[key].shape[1] != width:
            raise DataError(f"{schema.OBS}/{key} has {found[key].shape[1]} columns; it must have {width}")
    rgb, depth = found.get(schema.RGB), found.get(schema.DEPTH)
    return [
        Observation(
            time_s=float(found["time_s"][i, 0]),
            corner_positions=found["corner_positions"][i].reshape(2, 3),
            holder_position=found["holder_position"][i],
            word=found["word"][i],
            word_strength=float(found["word_strength"][i, 0]),
            contact_portion=float(found["contact_portion"][i, 0]),
            rgb=None if rgb is None else rgb[i],
            depth=None if depth is None else depth[i, ..., 0],
        )
        for i in range(count + 1)
    ]


def _truths(rows: _Rows, count: int) -> list[Truth]:
    states, final = rows.take(schema.STATES, ndim=2), rows.take(schema.FINAL_STATE, ndim=1)
    contact, area = rows.take(schema.CONTACT_TRUE, ndim=2), rows.take(schema.FLAT_AREA, ndim=2)
    if len(states) != count or final.shape != states.shape[1:] or len(final) % 3:
        raise DataError(
            f"{schema.STATES} has shape {states.shape} and {schema.FINAL_STATE} {final.shape};"
            f" {count} rows of three columns for each node are needed, and one row after the last action"
        )
    for key, column in ((schema.CONTACT_TRUE, contact), (schema.FLAT_AREA, area)):
        if column.shape != (count + 1, 1):
            raise DataError(f"{key} has shape {column.shape}; it must be {(count + 1, 1)}")
    return [
        Truth(nodes=row.reshape(-1, 3), contact_portion_true=float(contact[i, 0]), flat_area=float(area[i, 0]))
        for i, row in enumerate([*states, final])
    ]


def _steps(
    rows: _Rows, actions: NDArray[np.float64], observations: list[Observation], truths: list[Truth]
) -> tuple[Step, ...]:
    metres = _metres(rows, actions)
    std: NDArray[np.float64] | None = None
    if rows.has(schema.ACTION_STD):
        std = rows.take(schema.ACTION_STD, ndim=2)
    phases = [b"place"] * len(actions)
    if rows.has(schema.PHASE):
        phases = rows.take(schema.PHASE, ndim=1, dtype="|S8").tolist()
    if len(phases) != len(actions) or (std is not None and std.shape != actions.shape):
        raise DataError(f"{schema.PHASE} or {schema.ACTION_STD} has not one row for each of {len(actions)} actions")
    return tuple(
        Step(
            observation=observations[i],
            truth=truths[i],
            action=metres[i],
            action_std=None if std is None or np.isnan(std[i]).all() else std[i],
            phase=cast(Phase, phases[i].decode("ascii", "replace")),
        )
        for i in range(len(actions))
    )


def _metres(rows: _Rows, actions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Displacements: those that were kept beside the actions where both agree, else actions times the limit."""
    if not np.isfinite(actions).all() or np.abs(actions).max() > 1:
        raise DataError(f"{schema.ACTIONS} goes to {np.abs(actions).max()}; it must be within -1..1")
    if not rows.has(schema.ACTION_M):
        return actions * ACTION_LIMIT_M
    metres = rows.take(schema.ACTION_M, ndim=2)
    if metres.shape != actions.shape or not np.allclose(metres / ACTION_LIMIT_M, actions, rtol=1e-6, atol=1e-9):
        raise DataError(
            f"{schema.ACTION_M} is not {schema.ACTIONS} times {ACTION_LIMIT_M};"
            f" where the actions were changed on purpose, delete {schema.ACTION_M}"
        )
    return metres
