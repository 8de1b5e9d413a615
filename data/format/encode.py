"""An episode as the attributes and data sets of one robomimic demo."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from layflat.data.arrays import FloatArray
from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import Attribute, digest, robot_of, set_attribute
from layflat.data.types import ACTION_LIMIT_M, DisturbanceRecord, Episode, Observation, Step

CHUNK_BYTES = 1 << 20
PACKING = {"compression": "gzip", "compression_opts": 1}
"""Of real frames, half the size of lzf for half as much time again, and every HDF5 tool reads it: lzf is h5py's own."""
LIBVER = ("v110", "v110")
"""The oldest format of HDF5 that carries checksums in its own structures, so that damage is noticed; h5py reads it."""
INT64_MAX = 2**63 - 1
AGREED = (schema.ROBOT, schema.ACTION_AXES, schema.TASK, schema.PHYSICS, schema.CLOTH, schema.STEP_S, schema.DESCRIPTOR)
"""Attributes in which all episodes of a session agree."""


def attributes_of(episode: Episode, uid: str) -> dict[str, Attribute]:
    """All attributes of the demo except the digest."""
    start = {str(key): float(value) for key, value in episode.start.items()}
    observations, ground_truth = episode.observations(), episode.final_ground_truth
    attributes: dict[str, Attribute] = {
        schema.UID: uid,
        schema.VERSION: schema.SCHEMA_VERSION,
        schema.NUM_SAMPLES: len(episode.steps),
        schema.ROBOT: episode.robot.name,
        schema.ACTION_AXES: episode.robot.axes_json(),
        schema.TASK: episode.task,
        schema.PHYSICS: episode.physics,
        schema.CLOTH: episode.cloth,
        schema.STEP_S: float(episode.step_s),
        schema.DESCRIPTOR: episode.descriptor,
        schema.ACTION_LIMIT: ACTION_LIMIT_M,
        schema.SEED: int(episode.seed),
        schema.SOURCE: episode.source,
        schema.DISTURBANCE: episode.disturbance,
        schema.DISTURBANCES: disturbances_text(episode.disturbances),
        schema.OUTCOME: episode.outcome,
        schema.SUCCESS: episode.outcome == "success",
        schema.STOPPED_BY: episode.stopped_by,
        schema.WALL_S: float(episode.wall_s),
        schema.START: _json(start, schema.START),
        schema.SIM_CONFIG: _json(episode.sim_config, schema.SIM_CONFIG),
        schema.FIRST_STEP: int(episode.first_step),
        schema.CONTACT_START: float(observations[0].contact_portion),
        schema.CONTACT_FINAL: float(observations[-1].contact_portion),
        schema.CONTACT_TRUE_FINAL: math.nan if ground_truth is None else float(ground_truth.contact_portion_true),
        schema.FLAT_AREA_FINAL: math.nan if ground_truth is None else float(ground_truth.flat_area),
        schema.PROVENANCE: _json(
            {**vars(episode.provenance), "versions": dict(episode.provenance.versions)}, schema.PROVENANCE
        ),
    }
    for key, value in attributes.items():
        _check_storable(key, value)
    return attributes


def arrays_of(episode: Episode, *, save_images: bool) -> dict[str, NDArray[Any]]:
    """Every data set of the demo by its key; images only where asked for and there."""
    steps = episode.steps
    if not steps:
        raise DataError("the episode has no steps; there is nothing to keep")
    action_m = np.array([step.action for step in steps])
    _check_actions(action_m)
    unknown_std = np.full(action_m.shape[1], np.nan)
    ground_truths = episode.ground_truths()
    sizes = {ground_truth.nodes.shape[0] for ground_truth in ground_truths}
    if len(sizes) != 1:
        raise DataError(
            f"the number of cloth nodes changes within the episode ({sorted(sizes)}); it must stay the same"
        )
    nodes = np.array([ground_truth.nodes.reshape(-1) for ground_truth in ground_truths])
    observed = _observed(episode.observations(), save_images=save_images)
    return {
        schema.ACTIONS: action_m / ACTION_LIMIT_M,
        schema.ACTION_M: action_m,
        schema.ACTION_STD: np.array([unknown_std if s.action_std is None else s.action_std for s in steps]),
        schema.PHASE: np.array([step.phase.encode("ascii") for step in steps], dtype="S8"),
        schema.REWARDS: np.diff(episode.contact()),
        schema.DONES: np.arange(1, len(steps) + 1) == len(steps),
        schema.STATES: nodes[:-1],
        schema.FINAL_STATE: nodes[-1],
        schema.CONTACT_TRUE: np.array([[ground_truth.contact_portion_true] for ground_truth in ground_truths]),
        schema.FLAT_AREA: np.array([[ground_truth.flat_area] for ground_truth in ground_truths]),
        **({schema.JOINTS: episode.initial_joints} if episode.initial_joints.size else {}),
        **_told_by_few(steps),
        **{f"{schema.OBS}/{key}": rows[:-1] for key, rows in observed.items()},
        **{f"{schema.NEXT_OBS}/{key}": rows[1:] for key, rows in observed.items()},
    }


def _told_by_few(steps: Sequence[Step]) -> dict[str, NDArray[Any]]:
    """Forces, pulls and interventions: those that any step has."""
    forces = np.array([step.force_n for step in steps])
    nodes = np.array([-1 if step.drag is None else step.drag.node for step in steps])
    nowhere = np.full(3, np.nan)
    taken = np.array([step.intervention for step in steps])
    found: dict[str, NDArray[Any]] = {}
    if forces.view(np.uint64).any():  # Not by value: -0.0 is kept, too.
        found[schema.FORCE] = forces
    if (nodes >= 0).any():
        found[schema.PULL_NODE] = nodes
        found[schema.PULL_TARGET] = np.array([nowhere if s.drag is None else s.drag.target_m for s in steps])
    if taken.any():
        found[schema.INTERVENTION] = taken
    if any(step.hand_m is not None for step in steps):
        found[schema.HAND] = np.array([hand_row(step.hand_m) for step in steps])
    return found


def hand_row(hand_m: FloatArray | None) -> FloatArray:
    """(6,) with NaN for the hands that are not there."""
    row = np.full(6, np.nan)
    if hand_m is not None:
        row[: hand_m.size] = hand_m.ravel()
    return row


def write_demo(group: h5py.Group, attributes: Mapping[str, Attribute], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Fill an empty group."""
    for key, value in {**attributes, schema.DIGEST: digest(attributes)}.items():
        set_attribute(group.attrs, key, value)
    robot = robot_of(attributes)
    for field in schema.FIELDS:
        if field.key not in arrays:
            continue
        rows = np.ascontiguousarray(arrays[field.key], dtype=field.dtype)
        chunked = {"chunks": _chunks(rows), "fletcher32": True} if rows.size else {}
        packed = PACKING if field.packed and rows.size else {}
        dataset = group.create_dataset(field.key, rows.shape, rows.dtype, **chunked, **packed)
        earlier = field.key.replace(f"{schema.NEXT_OBS}/", f"{schema.OBS}/")
        follows = packed and earlier != field.key and np.array_equal(arrays[earlier][1:], rows[:-1])
        _fill(dataset, rows, group[earlier] if follows else None)
        set_attribute(dataset.attrs, schema.UNIT, field.unit)
        set_attribute(dataset.attrs, schema.FRAME, field.frame)
        set_attribute(dataset.attrs, schema.COLUMNS, json.dumps(schema.columns_of(field, robot)))


def _fill(dataset: h5py.Dataset, rows: NDArray[Any], before: h5py.Dataset | None) -> None:
    """Write all rows; where ``before`` has them one step later, its packed bytes are taken: half the work."""
    ready = 0
    if before is not None:
        ready, rest = len(rows) - 1, (0,) * (rows.ndim - 1)
        for step_index in range(ready):
            mask, chunk = before.id.read_direct_chunk((step_index + 1, *rest))
            dataset.id.write_direct_chunk((step_index, *rest), chunk, mask)
    if rows.size:
        dataset[ready:] = rows[ready:]


def write_session_attributes(data: h5py.Group, first: Mapping[str, Attribute], *, total: int) -> None:
    """Describe the session after the attributes of its first demo."""
    for key in (*AGREED, schema.ACTION_LIMIT, schema.VERSION):
        set_attribute(data.attrs, key, first[key])
    set_attribute(data.attrs, schema.SCHEMA_NAME, schema.SCHEMA)
    set_attribute(data.attrs, schema.FRAMES, json.dumps(dict(schema.FRAME_TEXTS)))
    data.attrs[schema.TOTAL] = total
    versions = json.loads(str(first[schema.PROVENANCE]))["versions"]
    env_args = {
        "type": schema.ENV_TYPE_GYM,
        # robomimic's documentation says env_type where its code reads type.
        "env_type": schema.ENV_TYPE_GYM,
        "env_name": schema.ENV_NAME,
        "env_version": versions.get("layflat", "unknown"),
        "env_kwargs": {key: first[key] for key in (schema.ROBOT, schema.CLOTH, schema.TASK, schema.PHYSICS)},
    }
    # As others expect it, of variable length; we ourselves never read it.
    data.attrs[schema.ENV_ARGS] = json.dumps(env_args)


def _observed(observations: tuple[Observation, ...], *, save_images: bool) -> dict[str, NDArray[Any]]:
    """(N + 1, ...) rows by observation key."""
    columns = {}
    for field in schema.OBSERVATION_FIELDS:
        values = [getattr(observation, field.key) for observation in observations]
        if field.optional:
            if not save_images or all(value is None for value in values):
                continue
            _check_images(field.key, values)
        rows = np.array(values, dtype=field.dtype)
        if field.key == schema.DEPTH:
            rows = rows[..., np.newaxis]
        columns[field.key] = rows if field.optional else rows.reshape(len(values), -1)
    return columns


def _check_images(key: str, images: list[NDArray[Any] | None]) -> None:
    missing = [step_index for step_index, image in enumerate(images) if image is None]
    if missing:
        raise DataError(f"{key} is missing at step {missing[0]} but not at others; all steps need it, or none")
    shapes = {image.shape for image in images if image is not None}
    if len(shapes) != 1:
        raise DataError(f"{key} changes its shape within the episode ({sorted(shapes)}); it must stay the same")


def _check_actions(action_m: NDArray[np.float64]) -> None:
    """Clipping here would record something that was not done."""
    step_index, axis = np.unravel_index(np.abs(action_m).argmax(), action_m.shape)
    if abs(action_m[step_index, axis]) > ACTION_LIMIT_M:
        raise DataError(
            f"step {step_index}: action component {axis} is {action_m[step_index, axis]:.6g} m;"
            f" it must be within +-{ACTION_LIMIT_M} m"
        )


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


def disturbances_text(records: Iterable[DisturbanceRecord]) -> str:
    """What befell the cloth as JSON."""
    return _json([vars(record) | {"plan": dict(record.plan)} for record in records], schema.DISTURBANCES)


def _json(value: Mapping[str, object] | list[dict[str, object]], key: str) -> str:
    try:
        return json.dumps(value if isinstance(value, list) else dict(value), allow_nan=False)
    except ValueError:
        raise DataError(f"{key} is {value!r}; all its numbers must be finite") from None
    except TypeError:
        raise DataError(f"{key} is {value!r}; it may hold text, numbers, lists and objects only") from None


def _chunks(rows: NDArray[Any]) -> tuple[int, ...]:
    """One image per chunk; otherwise as many rows as make about CHUNK_BYTES."""
    if rows.ndim == 4:
        return (1, *rows.shape[1:])
    per_row = rows[0].nbytes
    return (max(1, min(len(rows), CHUNK_BYTES // per_row)), *rows.shape[1:])
