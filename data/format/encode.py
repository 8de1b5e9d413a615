"""Encodes an episode as the attributes and data sets of one robomimic demo."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import Attribute, digest, robot_of, set_attributes, set_trusted_attributes
from layflat.data.format.rows import default_rows
from layflat.data.format.structure_checks import check_camera, check_mesh
from layflat.data.robot import RobotSpec
from layflat.data.types import ACTION_LIMIT_M, DisturbanceRecord, Episode, GroundTruth, Observation, Step

CHUNK_BYTES = 1 << 20
PACKING = {"compression": "gzip", "compression_opts": 1}
"""Half the size of lzf on real frames for half as much time again, and every HDF5 tool reads it: lzf is h5py's own."""
LIBVER = ("v110", "v110")
"""The oldest format of HDF5 that carries checksums in its own structures, so that damage is noticed; h5py reads it."""
INT64_MAX = 2**63 - 1


def shared_attributes(episode: Episode) -> dict[str, Attribute]:
    """Return the attributes that all episodes of a session share, SESSION_KEYS."""
    return {
        schema.ROBOT: episode.robot.name,
        schema.ACTION_AXES: episode.robot.axes_json(),
        schema.TASK: episode.task,
        schema.PHYSICS: episode.physics,
        schema.CLOTH: episode.cloth,
        schema.STEP_S: float(episode.step_s),
        schema.DESCRIPTOR: episode.descriptor,
    }


def attributes_of(episode: Episode, uid: str) -> dict[str, Attribute]:
    """Return all attributes of the demo except the digest; DataError where one cannot be stored."""
    start = {str(key): float(value) for key, value in episode.start.items()}
    contact_start = (episode.steps[0].observation if episode.steps else episode.final_observation).contact_portion
    attributes: dict[str, Attribute] = {
        schema.UID: uid,
        schema.VERSION: schema.SCHEMA_VERSION,
        schema.NUM_SAMPLES: len(episode.steps),
        **shared_attributes(episode),
        schema.ACTION_LIMIT: ACTION_LIMIT_M,
        schema.SEED: int(episode.seed),
        schema.SOURCE: episode.source,
        schema.DISTURBANCE: episode.disturbance,
        schema.DISTURBANCES: disturbances_json(episode.disturbances),
        schema.OUTCOME: episode.outcome,
        schema.SUCCESS: episode.outcome == "success",
        schema.STOPPED_BY: episode.stopped_by,
        schema.WALL_S: float(episode.wall_s),
        schema.START: _json(start, schema.START),
        schema.SIM_CONFIG: _json(dict(episode.sim_config), schema.SIM_CONFIG),
        schema.FIRST_STEP: int(episode.first_step),
        schema.CONTACT_START: float(contact_start),
        schema.CONTACT_FINAL: float(episode.final_observation.contact_portion),
        schema.PROVENANCE: _json(
            {**vars(episode.provenance), "versions": dict(episode.provenance.versions)}, schema.PROVENANCE
        ),
    }
    if episode.final_ground_truth is not None:
        attributes[schema.CONTACT_TRUE_FINAL] = float(episode.final_ground_truth.contact_portion_true)
        attributes[schema.FLAT_AREA_FINAL] = float(episode.final_ground_truth.flat_area)
    if episode.decision_s is not None:
        attributes[schema.DECISION_S] = float(episode.decision_s)
    if episode.camera is not None:
        attributes[schema.CAMERA] = episode.camera.to_json()
    if episode.mesh_shape is not None:
        attributes[schema.MESH_ROWS], attributes[schema.MESH_COLUMNS] = episode.mesh_shape
    for key, value in attributes.items():
        _check_storable(key, value)
    return attributes


def disturbances_json(records: Iterable[DisturbanceRecord]) -> str:
    """Return disturbances as JSON."""
    return _json([vars(record) | {"plan": dict(record.plan)} for record in records], schema.DISTURBANCES)


# Rows: what happens at one moment and in one step, by key of the schema; for files and journals alike.


def moment_values(
    observation: Observation, ground_truth: GroundTruth | None, *, save_images: bool
) -> dict[str, NDArray[Any]]:
    """Return the row of each observation and ground truth field at one moment; images where asked for and there."""
    values = {
        field.key: np.ravel(getattr(observation, field.key))
        for field in schema.OBSERVATION_FIELDS
        if not field.optional
    }
    if save_images and observation.rgb is not None:
        values[schema.RGB] = observation.rgb
    if save_images and observation.depth is not None:
        values[schema.DEPTH] = observation.depth[..., np.newaxis]
    if ground_truth is not None:
        values[schema.STATES] = ground_truth.nodes.ravel()
        values[schema.CONTACT_TRUE] = np.array([ground_truth.contact_portion_true])
        values[schema.FLAT_AREA] = np.array([ground_truth.flat_area])
    return values


def step_values(step: Step, robot: RobotSpec) -> dict[str, Any]:
    """Return the row of each of STEP_FIELDS."""
    return {
        schema.ACTION_M: step.action,
        schema.ACTION_STD: np.full(robot.size, np.nan) if step.action_std is None else step.action_std,
        schema.PHASE: step.phase.encode("ascii"),
        schema.FORCE: step.force_n,
        schema.DRAG_NODE: -1 if step.drag is None else step.drag.node,
        schema.DRAG_TARGET: np.full(3, np.nan) if step.drag is None else step.drag.target_m,
        schema.HAND: np.full(robot.hand_shape, np.nan) if step.hand_m is None else step.hand_m,
        schema.INTERVENTION: step.intervention,
    }


def check_step(step: Step, robot: RobotSpec) -> None:
    """Raise a DataError where a step is not of this robot or its action is beyond the limit.

    Clipping here would record something that was not done.
    """
    if step.action.shape != (robot.size,) or np.abs(step.action).max() > ACTION_LIMIT_M:
        raise DataError(
            f"action is {step.action} m; it must be {robot.size} numbers for robot {robot},"
            f" each within +-{ACTION_LIMIT_M} m"
        )
    if step.hand_m is not None and step.hand_m.shape != robot.hand_shape:
        raise DataError(f"hand_m has shape {step.hand_m.shape}; robot {robot} needs {robot.hand_shape}")


def arrays_of(episode: Episode, *, save_images: bool) -> dict[str, NDArray[Any]]:
    """Return every data set of the demo by its key; images only where asked for and there."""
    steps = episode.steps
    if not steps:
        raise DataError("the episode has no steps; there is nothing to save")
    for index, step in enumerate(steps):
        try:
            check_step(step, episode.robot)
        except DataError as error:
            raise DataError(f"step {index}: {error}") from None
    last, truth = episode.final_observation, episode.final_ground_truth
    check_camera(episode.camera, *(image.shape[:2] for image in (last.rgb, last.depth) if image is not None))
    check_mesh(episode.mesh_shape, None if truth is None else len(truth.nodes))
    ground_truths = (*(step.ground_truth for step in steps), truth)
    moments = _stacked(
        [
            moment_values(observation, ground_truth, save_images=save_images)
            for observation, ground_truth in zip(episode.observations(), ground_truths, strict=True)
        ]
    )
    arrays = _stacked([step_values(step, episode.robot) for step in steps])
    for field in (field for field in schema.STEP_FIELDS if field.optional):
        rows = arrays[field.key].astype(field.dtype)
        # Compared by their bits, so that -0.0 is saved.
        if rows.tobytes() == default_rows(field, rows.shape).tobytes():
            del arrays[field.key]
    arrays[schema.ACTIONS] = arrays[schema.ACTION_M] / ACTION_LIMIT_M
    arrays[schema.REWARDS] = np.diff(moments["contact_portion"][:, 0])
    arrays[schema.DONES] = np.arange(1, len(steps) + 1) == len(steps)
    if schema.STATES in moments:
        nodes = moments.pop(schema.STATES)
        arrays[schema.STATES], arrays[schema.FINAL_STATE] = nodes[:-1], nodes[-1]
        arrays |= {key: moments.pop(key) for key in (schema.CONTACT_TRUE, schema.FLAT_AREA)}
    if episode.initial_joints.size:
        arrays[schema.JOINTS] = episode.initial_joints
    for key, rows in moments.items():
        arrays[f"{schema.OBS}/{key}"], arrays[f"{schema.NEXT_OBS}/{key}"] = rows[:-1], rows[1:]
    return arrays


def _stacked(values: Sequence[Mapping[str, Any]]) -> dict[str, NDArray[Any]]:
    """Return the rows of each key; DataError where some lack it, or are of another shape."""
    stacked = {}
    for key in dict.fromkeys(key for row in values for key in row):
        missing = [index for index, row in enumerate(values) if key not in row]
        if missing:
            raise DataError(f"{key} is missing at step {missing[0]} but not at others; all steps need it, or none")
        shapes = {np.shape(row[key]) for row in values}
        if len(shapes) > 1:
            raise DataError(f"{key} changes its shape within the episode ({sorted(shapes)}); it must stay the same")
        stacked[key] = np.array([row[key] for row in values])
    return stacked


def write_demo(group: h5py.Group, attributes: Mapping[str, Attribute], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Fill an empty group."""
    for field in schema.FIELDS.values():
        if field.key not in arrays:
            continue
        rows = np.ascontiguousarray(arrays[field.key], dtype=field.dtype)
        chunked = {"chunks": _chunks(rows), "fletcher32": True} if rows.size else {}
        packed = PACKING if rows.ndim == 4 and rows.size else {}
        dataset = group.create_dataset(field.key, rows.shape, rows.dtype, **chunked, **packed)
        earlier = field.key.replace(f"{schema.NEXT_OBS}/", f"{schema.OBS}/")
        follows = packed and earlier != field.key and np.array_equal(arrays[earlier][1:], rows[:-1])
        _fill(dataset, rows, group[earlier] if follows else None)
    describe_demo(group, attributes)


def describe_demo(group: h5py.Group, attributes: Mapping[str, Attribute]) -> None:
    """Write the attributes of a demo and of its data sets."""
    set_trusted_attributes(group, {**attributes, schema.DIGEST: digest(attributes)})
    robot = robot_of(attributes)
    for key in schema.FIELDS.keys() & set(_members(group)):
        field = schema.FIELDS[key]
        columns = json.dumps(schema.columns_of(field, robot))
        values = (field.unit, field.frame, columns, field.description)
        set_attributes(group[key], dict(zip(schema.DATASET_ATTRIBUTES, values, strict=True)))


def _members(group: h5py.Group) -> list[str]:
    """Return the paths of the data sets of a demo."""
    inner = (schema.OBS, schema.NEXT_OBS, schema.GROUND_TRUTH)
    return [*group, *(f"{key}/{member}" for key in inner if key in group for member in group[key])]


def _fill(dataset: h5py.Dataset, rows: NDArray[Any], before: h5py.Dataset | None) -> None:
    """Write all rows; where ``before`` has them one step later, copy its packed bytes, which is half the work."""
    ready = 0
    if before is not None:
        ready, rest = len(rows) - 1, (0,) * (rows.ndim - 1)
        for index in range(ready):
            mask, chunk = before.id.read_direct_chunk((index + 1, *rest))
            dataset.id.write_direct_chunk((index, *rest), chunk, mask)
    if rows.size:
        dataset[ready:] = rows[ready:]


def write_session_attributes(data: h5py.Group, first: Mapping[str, Attribute], *, total: int) -> None:
    """Describe the session after the attributes of its first demo."""
    attributes = {key: first[key] for key in (*schema.SESSION_KEYS, schema.ACTION_LIMIT, schema.VERSION)}
    attributes |= {schema.SCHEMA_NAME: schema.SCHEMA, schema.FRAMES: json.dumps(dict(schema.FRAME_TEXTS))}
    set_trusted_attributes(data, attributes)
    data.attrs[schema.TOTAL] = total
    versions = json.loads(str(first[schema.PROVENANCE]))["versions"]
    settings = json.loads(str(first[schema.SIM_CONFIG]))
    env_args = {
        "type": schema.ENV_TYPE_GYM,
        # robomimic's documentation says env_type where its code reads type.
        "env_type": schema.ENV_TYPE_GYM,
        "env_name": schema.ENV_NAME,
        "env_version": versions.get("layflat", "unknown"),
        "env_kwargs": {key: first[key] for key in (schema.ROBOT, schema.CLOTH, schema.TASK, schema.PHYSICS)}
        | {key: value for key, value in settings.items() if not key.startswith(f"{schema.CLOTH}_")},
    }
    # As others expect it, of variable length; never read here.
    data.attrs[schema.ENV_ARGS] = json.dumps(env_args)


def _check_storable(key: str, value: Attribute) -> None:
    if isinstance(value, str):
        try:
            value.encode("utf-8")
        except UnicodeEncodeError:
            raise DataError(f"{key} is {value!r}; it must be text that UTF-8 can hold") from None
        if "\0" in value:
            raise DataError(f"{key} is {value!r}; it must not hold a NUL character")
    elif isinstance(value, float) and not math.isfinite(value):
        raise DataError(f"{key} is {value}; it must be finite")
    elif isinstance(value, int) and not -INT64_MAX <= value <= INT64_MAX:
        raise DataError(f"{key} is {value}; it must fit into 64 bits")


def _json(value: object, key: str) -> str:
    try:
        return json.dumps(value, allow_nan=False)
    except ValueError:
        raise DataError(f"{key} is {value!r}; all its numbers must be finite") from None
    except TypeError:
        raise DataError(f"{key} is {value!r}; it may hold text, numbers, lists and objects only") from None


def _chunks(rows: NDArray[Any]) -> tuple[int, ...]:
    """Return one image per chunk; otherwise as many rows as make about CHUNK_BYTES."""
    if rows.ndim == 4:
        return (1, *rows.shape[1:])
    per_row = rows[0].nbytes
    return (max(1, min(len(rows), CHUNK_BYTES // max(1, per_row))), *rows.shape[1:])
