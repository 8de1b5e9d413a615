"""Back from robomimic's form: episodes of a file in our layout that another tool has written or changed.

Such a tool may have dropped attributes that it does not know, converted numbers, packed data sets anew, or left out
what is optional. What an episode cannot do without must be there: actions, ``obs``, ``next_obs``, ``states`` and
``truth``. What only an attribute told is taken from the file where it is, and is otherwise marked as unknown.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import h5py
import numpy as np
from numpy.typing import NDArray

from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import Attribute, json_object
from layflat.data.format.decode import TOLD_BY_FEW, drag_of, hand_of, observations_of, without_steps
from layflat.data.format.encode import attributes_of
from layflat.data.format.migrate import PLAN, disturbances_from_2
from layflat.data.format.structure_checks import check_claim, check_hard_links, check_stored_here
from layflat.data.robot import RobotSpec
from layflat.data.types import (
    ACTION_LIMIT_M,
    FLAT_AREA,
    STEP_S,
    Episode,
    GroundTruth,
    Observation,
    Phase,
    Provenance,
    Step,
)

UNKNOWN_SEED = -1
"""Of an episode whose file does not tell: it can be shown and learned from, but its start cannot be made again."""
UNKNOWN_SOURCE = "imported"
_TOLD = (
    schema.ROBOT, schema.ACTION_AXES, schema.TASK, schema.PHYSICS, schema.CLOTH, schema.STEP_S, schema.DESCRIPTOR,
    schema.SEED, schema.SOURCE, schema.DISTURBANCE,
    schema.DISTURBANCES, schema.OUTCOME, schema.STOPPED_BY, schema.WALL_S, schema.START, schema.SIM_CONFIG,
    schema.FIRST_STEP, schema.PROVENANCE,
)  # fmt: skip
"""What only an attribute can tell; all others follow from the arrays, or are made anew."""


def imported_episode(group: h5py.Group, *, file: Path, cloth: str | None, robots: Sequence[RobotSpec] = ()) -> Episode:
    """The episode of one demo of a foreign file; DataError in one sentence where it cannot be one.

    ``cloth`` is taken where the file names none.
    """
    check_hard_links(group)
    rows = _Rows(group)
    actions = rows.take(schema.ACTIONS, ndim=2)
    told = _told(group)
    robot = _robot(told, actions, robots)
    if len(actions) < 1 or actions.shape[1] != robot.size:
        raise DataError(f"{group.name}/{schema.ACTIONS} has shape {actions.shape}; robot {robot} has {robot.size}")
    observations = _observations(rows, len(actions))
    ground_truths = _truths(rows, len(actions))
    joints = rows.take(schema.JOINTS, ndim=1) if rows.has(schema.JOINTS) else np.zeros(0)
    unknown = _unknown(robot, observations, ground_truths)
    attributes = attributes_of(unknown, "") | {schema.CLOTH: cloth or ""} | told
    if not attributes[schema.CLOTH]:
        raise DataError(f"{group.name} does not say of which cloth it is; name the cloth")
    nothing = vars(Provenance(command=f"imported from {file.name}"))
    attributes[schema.PROVENANCE] = json.dumps(
        nothing | json_object({schema.PROVENANCE: "{}"} | told, schema.PROVENANCE)
    )
    if not float(attributes[schema.STEP_S]) > 0:
        raise DataError(f"attribute {schema.STEP_S} is {attributes[schema.STEP_S]}; it must be above 0")
    phases = _phases(rows, len(actions))
    if schema.DISTURBANCES not in told:
        attributes[schema.DISTURBANCES] = disturbances_from_2({PLAN: _plan(group)} | attributes, phases)
    known = without_steps(attributes, observations[-1], ground_truths[-1])
    return replace(known, steps=_steps(rows, actions, observations, ground_truths, phases), initial_joints=joints)


def _unknown(robot: RobotSpec, observations: list[Observation], ground_truths: list[GroundTruth]) -> Episode:
    """What an episode is of which nothing is told."""
    return Episode(
        robot=robot,
        cloth="",
        seed=UNKNOWN_SEED,
        source=UNKNOWN_SOURCE,
        steps=(),
        final_observation=observations[-1],
        final_ground_truth=ground_truths[-1],
        stopped_by="step_limit",
        # By what the recorder goes by.
        outcome="success" if ground_truths[-1].flat_area > FLAT_AREA else "failure",
        step_s=_step_s(observations),
    )


def _told(group: h5py.Group) -> dict[str, Attribute]:
    """Attributes of the demo where it has them, else of /data, else from env_args; each of its right type."""
    data = group.parent
    found: dict[str, Attribute] = {}
    env = json_object(data.attrs, schema.ENV_ARGS) if schema.ENV_ARGS in data.attrs else {}
    kwargs = env.get("env_kwargs")
    if isinstance(kwargs, dict) and isinstance(kwargs.get("cloth"), str):
        found[schema.CLOTH] = kwargs["cloth"]
    if isinstance(kwargs, dict) and isinstance(kwargs.get("robot"), str):
        found[schema.ROBOT] = kwargs["robot"]
    for attributes in (data.attrs, group.attrs):
        found |= {key: _plain(attributes, key, schema.DEMO_ATTRIBUTES[key]) for key in _TOLD if key in attributes}
    return found


def _plain(attributes: Any, key: str, wanted: type) -> Attribute:
    """A value of the type that our own attribute has; whole numbers may stand for others."""
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


def _robot(told: Mapping[str, Attribute], actions: NDArray[np.float64], robots: Sequence[RobotSpec]) -> RobotSpec:
    """Return the robot that the file names, with the axes that it names, else the known robot whose action fits."""
    if schema.ROBOT in told and schema.ACTION_AXES in told:
        return RobotSpec.from_json(str(told[schema.ROBOT]), str(told[schema.ACTION_AXES]))
    for robot in robots:
        if told.get(schema.ROBOT, robot.name) == robot.name and robot.size == actions.shape[1]:
            return robot
    raise DataError(
        f"the robot is {told.get(schema.ROBOT, 'not named')} and an action has {actions.shape[1]} components;"
        f" there are {', '.join(f'{robot} with {robot.size}' for robot in robots) or 'none to choose from'}"
    )


def _step_s(observations: list[Observation]) -> float:
    """From the times that were recorded, where all steps are equally long; else the usual length."""
    steps = np.diff([observation.time_s for observation in observations])
    even = steps.min() > 0 and np.allclose(steps, steps[0], rtol=1e-4)
    return float(np.round(steps.mean(), 6)) if even else STEP_S


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
        check_stored_here(dataset, name)
        if dataset.dtype.kind not in ("S" if dtype[1] == "S" else "fiub"):
            raise DataError(f"{name} is of type {dataset.dtype}; it must be convertible to {np.dtype(dtype)}")
        if dataset.shape is None or dataset.ndim != ndim:
            raise DataError(f"{name} has shape {dataset.shape}; it must have {ndim} dimensions")
        check_claim(dataset, name, self._file_bytes)
        return np.asarray(dataset[()]).astype(dtype)


def _observations(rows: _Rows, count: int) -> list[Observation]:
    """All count + 1, from ``obs`` and the last row of ``next_obs``."""
    found: dict[str, NDArray[Any]] = {}
    for field in schema.OBSERVATION_FIELDS:
        key, after = f"{schema.OBS}/{field.key}", f"{schema.NEXT_OBS}/{field.key}"
        if field.optional and not (rows.has(key) and rows.has(after)):
            continue
        before = rows.take(key, ndim=len(field.shape), dtype=field.dtype)
        later = rows.take(after, ndim=len(field.shape), dtype=field.dtype)
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
    return observations_of(found)


def _truths(rows: _Rows, count: int) -> list[GroundTruth]:
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
        GroundTruth(nodes=row.reshape(-1, 3), contact_portion_true=float(contact[i, 0]), flat_area=float(area[i, 0]))
        for i, row in enumerate([*states, final])
    ]


def _plan(group: h5py.Group) -> str:
    """What version 2 told of a disturbance."""
    return str(_plain(group.attrs, PLAN, str)) if PLAN in group.attrs else "{}"


def _phases(rows: _Rows, count: int) -> NDArray[Any]:
    """(count,) bytes."""
    if not rows.has(schema.PHASE):
        return np.full(count, b"place")
    phases = rows.take(schema.PHASE, ndim=1, dtype="|S8")
    if len(phases) != count:
        raise DataError(f"{schema.PHASE} has {len(phases)} rows; it must have one for each of {count} actions")
    return phases


def _told_by_few(rows: _Rows, count: int) -> list[NDArray[Any]]:
    """Rows of the data sets in the order of TOLD_BY_FEW, also where they are missing."""
    found = []
    for field in (field for key in TOLD_BY_FEW for field in schema.FIELDS if field.key == key):
        shape = (count, *(n for n in field.shape[1:] if isinstance(n, int)))
        there = rows.has(field.key)
        values = rows.take(field.key, ndim=len(shape), dtype=field.dtype) if there else np.full(shape, field.absent)
        if values.shape != shape:
            raise DataError(f"{field.key} has shape {values.shape}; it must be {shape}")
        found.append(values)
    return found


def _steps(
    rows: _Rows,
    actions: NDArray[np.float64],
    observations: list[Observation],
    ground_truths: list[GroundTruth],
    phases: NDArray[Any],
) -> tuple[Step, ...]:
    metres = _metres(rows, actions)
    std: NDArray[np.float64] | None = None
    if rows.has(schema.ACTION_STD):
        std = rows.take(schema.ACTION_STD, ndim=2)
    if std is not None and std.shape != actions.shape:
        raise DataError(f"{schema.ACTION_STD} has shape {std.shape}; it must be {actions.shape}")
    forces, nodes, targets, taken, hands = _told_by_few(rows, len(actions))
    return tuple(
        Step(
            observation=observations[i],
            ground_truth=ground_truths[i],
            action=metres[i],
            action_std=None if std is None or np.isnan(std[i]).all() else std[i],
            phase=cast(Phase, bytes(phases[i]).decode("ascii", "replace")),
            drag=drag_of(int(nodes[i]), targets[i]),
            force_n=forces[i],
            intervention=bool(taken[i]),
            hand_m=hand_of(hands[i]),
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
