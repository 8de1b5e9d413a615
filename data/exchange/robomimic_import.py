"""Imports episodes of a robomimic file in our layout that another tool has written or changed.

Such a tool may have dropped attributes that it does not know, converted numbers, packed data sets again, or omitted
what is optional. Required are actions, ``obs`` and ``next_obs``; ``states`` and ``ground_truth`` come together or not
at all. Attributes are taken from the file where they are there, and get a default otherwise.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import h5py
import numpy as np
from numpy.typing import NDArray

from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import Attribute, json_object
from layflat.data.format.decode import copied_attributes, decode_episode
from layflat.data.format.rows import default_rows
from layflat.data.format.structure_checks import check_claim, check_hard_links, check_stored_here
from layflat.data.robot import RobotSpec
from layflat.data.types import ACTION_LIMIT_M, FLAT_AREA, STEP_S, Episode, Provenance

UNKNOWN_SEED = -1
"""Seed of an episode whose file has none: it can be shown and learned from, but its start cannot be simulated again."""
UNKNOWN_SOURCE = "imported"
_READ = (
    *schema.SESSION_KEYS, schema.SEED, schema.SOURCE, schema.DISTURBANCE, schema.DISTURBANCES, schema.OUTCOME,
    schema.STOPPED_BY, schema.WALL_S, schema.START, schema.SIM_CONFIG, schema.FIRST_STEP, schema.PROVENANCE,
    *schema.OPTIONAL_ATTRIBUTES,
)  # fmt: skip
"""Attributes that are read; all others follow from the arrays, or are written again."""


def import_episode(group: h5py.Group, *, file: Path, cloth: str | None, robots: Sequence[RobotSpec] = ()) -> Episode:
    """Return the episode of one demo of a foreign file; DataError in one sentence where it is none.

    ``cloth`` is used where the file names none, ``robots`` where it describes none.
    """
    check_hard_links(group)
    datasets = _Datasets(group)
    actions = datasets.read(schema.ACTIONS, ndim=2)
    attributes = _attributes(group)
    robot = _robot(attributes, actions, robots)
    if len(actions) < 1 or actions.shape[1] != robot.size:
        raise DataError(f"{group.name}/{schema.ACTIONS} has shape {actions.shape}; robot {robot} has {robot.size}")
    rows = _step_rows(datasets, actions, robot) | _observation_rows(datasets, len(actions))
    rows |= _ground_truth_rows(datasets, len(actions))
    joints = datasets.read(schema.JOINTS, ndim=1) if schema.JOINTS in group else ()
    attributes = _defaults(robot, rows, file) | {schema.CLOTH: cloth or ""} | attributes
    if not attributes[schema.CLOTH]:
        raise DataError(f"{group.name} does not say of which cloth it is; name the cloth")
    provenance = vars(Provenance()) | json_object(attributes, schema.PROVENANCE)
    attributes |= {schema.PROVENANCE: json.dumps(provenance)}
    if not float(attributes[schema.STEP_S]) > 0:
        raise DataError(f"attribute {schema.STEP_S} is {attributes[schema.STEP_S]}; it must be above 0")
    return decode_episode(attributes, rows, joints)


def _defaults(robot: RobotSpec, rows: Mapping[str, NDArray[Any]], file: Path) -> dict[str, Attribute]:
    """Return the attributes of an episode whose file has none.

    Its outcome is judged by the flat area, as a recorder does, or without ground truth by the camera's contact portion.
    """
    final = copied_attributes(rows)
    flat = float(final.get(schema.FLAT_AREA_FINAL, final[schema.CONTACT_FINAL]))
    return {
        schema.ROBOT: robot.name,
        schema.ACTION_AXES: robot.axes_json(),
        schema.TASK: "place",
        schema.PHYSICS: "bullet",
        schema.STEP_S: _step_s(rows["time_s"][:, 0]),
        schema.DESCRIPTOR: "word",
        schema.SEED: UNKNOWN_SEED,
        schema.SOURCE: UNKNOWN_SOURCE,
        schema.DISTURBANCE: "none",
        schema.DISTURBANCES: "[]",
        schema.OUTCOME: "success" if flat > FLAT_AREA else "failure",
        schema.STOPPED_BY: "step_limit",
        schema.WALL_S: 0.0,
        schema.START: "{}",
        schema.SIM_CONFIG: "{}",
        schema.FIRST_STEP: 0,
        schema.PROVENANCE: json.dumps({"command": f"imported from {file.name}"}),
    }


def _attributes(group: h5py.Group) -> dict[str, Attribute]:
    """Return attributes of the demo where it has them, else of /data, else from env_args; each of its right type."""
    data = group.parent
    env = json_object(data.attrs, schema.ENV_ARGS) if schema.ENV_ARGS in data.attrs else {}
    kwargs = env.get("env_kwargs")
    keys = (schema.ROBOT, schema.CLOTH, schema.TASK, schema.PHYSICS)
    found: dict[str, Attribute] = {}
    types = {**schema.DEMO_ATTRIBUTES, **schema.OPTIONAL_ATTRIBUTES}
    if isinstance(kwargs, dict):
        found |= {key: kwargs[key] for key in keys if isinstance(kwargs.get(key), str)}
    for attributes in (data.attrs, group.attrs):
        found |= {key: _plain(attributes, key, types[key]) for key in _READ if key in attributes}
    return found


def _plain(attributes: Any, key: str, wanted: type) -> Attribute:
    """Return a value of the type that our own attribute has; whole numbers may stand for others."""
    if attributes.get_id(key).shape != ():
        raise DataError(f"attribute {key} is an array; it must be one {wanted.__name__}")
    value: Any = attributes[key]
    value = value.item() if isinstance(value, np.generic) else value
    value = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
    if wanted is float and isinstance(value, int):
        value = float(value)
    if type(value) is not wanted:
        raise DataError(f"attribute {key} is {type(value).__name__}; it must be {wanted.__name__}")
    return cast(Attribute, value)


def _robot(attributes: Mapping[str, Attribute], actions: NDArray[np.float64], robots: Sequence[RobotSpec]) -> RobotSpec:
    """Return the robot that the file describes, else the known robot whose name and action fit."""
    name = attributes.get(schema.ROBOT)
    if name is not None and schema.ACTION_AXES in attributes:
        return RobotSpec.from_json(str(name), str(attributes[schema.ACTION_AXES]))
    for robot in robots:
        if name in (None, robot.name) and robot.size == actions.shape[1]:
            return robot
    raise DataError(
        f"the robot is {name or 'not named'} and an action has {actions.shape[1]} components;"
        f" there are {', '.join(f'{robot} with {robot.size}' for robot in robots) or 'none to choose from'}"
    )


def _step_s(time_s: NDArray[np.float64]) -> float:
    """Return the step from the recorded times, where all steps are equally long; else the usual one."""
    steps = np.diff(time_s)
    even = steps.min() > 0 and np.allclose(steps, steps[0], rtol=1e-4)
    return float(np.round(steps.mean(), 6)) if even else STEP_S


class _Datasets:
    """Data sets of a demo, each read after a look at what it claims."""

    def __init__(self, group: h5py.Group) -> None:
        self._group = group
        self._file_bytes = group.file.id.get_filesize()

    def __contains__(self, key: str) -> bool:
        return key in self._group

    def read(self, key: str, *, ndim: int, dtype: str = "<f8") -> NDArray[Any]:
        """Read a data set as ``dtype``; it may be stored otherwise, but must be numbers (or bytes for bytes)."""
        name, parent = f"{self._group.name}/{key}", key.rpartition("/")[0]
        if parent:
            if not isinstance(self._group.get(parent), h5py.Group):
                raise DataError(f"{self._group.name} has no group {parent}; an episode needs it")
            check_hard_links(self._group[parent])
        dataset = self._group.get(key)
        if not isinstance(dataset, h5py.Dataset):
            raise DataError(f"{self._group.name} has no data set {key}; an episode needs it")
        check_stored_here(dataset, name)
        if dataset.dtype.kind not in ("S" if dtype[1] == "S" else "fiub"):
            raise DataError(f"{name} is of type {dataset.dtype}; it must be convertible to {np.dtype(dtype)}")
        if dataset.shape is None or dataset.ndim != ndim:
            raise DataError(f"{name} has shape {dataset.shape}; it must have {ndim} dimensions")
        check_claim(dataset, name, self._file_bytes)
        return np.asarray(dataset[()]).astype(dtype)


def _observation_rows(datasets: _Datasets, count: int) -> dict[str, NDArray[Any]]:
    """Return count + 1 rows of each field, from ``obs`` and the last row of ``next_obs``."""
    found: dict[str, NDArray[Any]] = {}
    for field in schema.OBSERVATION_FIELDS:
        key, after = f"{schema.OBS}/{field.key}", f"{schema.NEXT_OBS}/{field.key}"
        if field.optional and not (key in datasets and after in datasets):
            continue
        before = datasets.read(key, ndim=len(field.shape), dtype=field.dtype)
        later = datasets.read(after, ndim=len(field.shape), dtype=field.dtype)
        if field.columns and before.shape[-1] != len(field.columns):
            raise DataError(f"{key} has {before.shape[-1]} columns; it must have {len(field.columns)}")
        if len(before) != count or later.shape != before.shape:
            raise DataError(
                f"{key} and {after} have shapes {before.shape} and {later.shape};"
                f" both must be alike, with a row for each of {count} actions"
            )
        if not np.array_equal(before[1:], later[:-1]):
            raise DataError(f"{after} is not {key} one step later; an episode is one unbroken series")
        found[field.key] = np.concatenate([before, later[-1:]])
    return found


def _ground_truth_rows(datasets: _Datasets, count: int) -> dict[str, NDArray[Any]]:
    """Return count + 1 rows of each field, or nothing without ground truth."""
    if schema.STATES not in datasets and schema.GROUND_TRUTH not in datasets:
        return {}
    states, final = datasets.read(schema.STATES, ndim=2), datasets.read(schema.FINAL_STATE, ndim=1)
    if len(states) != count or final.shape != states.shape[1:] or len(final) % 3:
        raise DataError(
            f"{schema.STATES} has shape {states.shape} and {schema.FINAL_STATE} {final.shape};"
            f" {count} rows of three columns for each node are needed, and one row after the last action"
        )
    rows = {key: datasets.read(key, ndim=2) for key in (schema.CONTACT_TRUE, schema.FLAT_AREA)}
    for key, column in rows.items():
        if column.shape != (count + 1, 1):
            raise DataError(f"{key} has shape {column.shape}; it must be {(count + 1, 1)}")
    return {schema.STATES: np.concatenate([states, final[np.newaxis]]), **rows}


def _step_rows(datasets: _Datasets, actions: NDArray[np.float64], robot: RobotSpec) -> dict[str, NDArray[Any]]:
    """Return one row for each action of each of STEP_FIELDS, with the defaults of those that are absent."""
    rows: dict[str, NDArray[Any]] = {schema.ACTION_M: _displacements(datasets, actions)}
    absent: dict[str, NDArray[Any]] = {
        schema.ACTION_STD: np.full(actions.shape, np.nan),
        schema.PHASE: np.full(len(actions), b"place", "|S8"),
    }
    for field in schema.STEP_FIELDS:
        shape = (len(actions), *(schema.row_shape(field, robot, {}) or ()))
        if field.key in rows:
            continue
        if field.key not in datasets:
            rows[field.key] = absent[field.key] if field.key in absent else default_rows(field, shape)
            continue
        rows[field.key] = datasets.read(field.key, ndim=len(shape), dtype=field.dtype)
        if rows[field.key].shape != shape:
            raise DataError(f"{field.key} has shape {rows[field.key].shape}; it must be {shape}")
    return rows


def _displacements(datasets: _Datasets, actions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the stored displacements where they agree with the actions, else actions times the limit."""
    if not np.isfinite(actions).all() or np.abs(actions).max() > 1:
        raise DataError(f"{schema.ACTIONS} has the value {np.abs(actions).max()}; it must be within -1..1")
    if schema.ACTION_M not in datasets:
        return actions * ACTION_LIMIT_M
    displacements = datasets.read(schema.ACTION_M, ndim=2)
    if displacements.shape != actions.shape or not np.allclose(
        displacements / ACTION_LIMIT_M, actions, rtol=1e-6, atol=1e-9
    ):
        raise DataError(
            f"{schema.ACTION_M} is not {schema.ACTIONS} times {ACTION_LIMIT_M};"
            f" where the actions were changed on purpose, delete {schema.ACTION_M}"
        )
    return displacements
