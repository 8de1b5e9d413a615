"""Checks one demo of a file that cannot be trusted, and makes an episode of it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any, cast

import h5py
import numpy as np
from numpy.typing import NDArray

from data import schema
from data.encode import Attribute, digest
from data.types import (
    ACTION_LIMIT_M,
    OUTCOMES,
    STOPS,
    TASKS,
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

EXPANSION_MAX = 1100
"""Bytes in memory per byte on disk: above deflate's limit of 1032. A small file that claims more is not believed."""


@dataclass(frozen=True, kw_only=True)
class DemoInfo:
    """What is known of a demo without reading its arrays."""

    uid: str
    task: Task
    cloth: str
    tick_s: float
    ticks: int
    seed: int
    source: str
    outcome: Outcome
    stopped_by: StoppedBy
    disturbance: str
    wall_s: float
    images: bool
    """Whether rgb or depth was kept."""


def typed_attributes(group: h5py.Group, types: Mapping[str, type]) -> dict[str, Attribute]:
    """The named attributes as plain Python values, or a DataError that says which one is wrong."""
    found: dict[str, Attribute] = {}
    for key, wanted in types.items():
        if key not in group.attrs:
            raise DataError(f"{group.name} has no attribute {key}")
        value = group.attrs[key]
        plain: Any = value.item() if isinstance(value, np.generic) else value
        if type(plain) is not wanted:
            raise DataError(f"attribute {key} of {group.name} is {type(plain).__name__}; it must be {wanted.__name__}")
        found[key] = cast(Attribute, plain)
    return found


def check_hard_links(group: h5py.Group) -> None:
    """A link may name another file of this machine; a session needs none."""
    for key in group:
        if not isinstance(group.get(key, getlink=True), h5py.HardLink):
            raise DataError(f"{group.name.rstrip('/')}/{key} is a link to elsewhere; a session holds its data itself")


def check_demo(group: h5py.Group, *, file_bytes: int) -> DemoInfo:
    """Names, types and shapes against the schema; reads attributes, not arrays."""
    attributes = typed_attributes(group, schema.DEMO_ATTRIBUTES)
    if group.attrs.get(schema.DIGEST) != digest(attributes):
        raise DataError(f"the attributes of {group.name} do not match their checksum")
    info = _info(group, attributes)
    check_hard_links(group)
    for key in (schema.OBS, schema.NEXT_OBS, schema.TRUTH):
        if not isinstance(group.get(key), h5py.Group):
            raise DataError(f"{group.name} has no group {key}")
        check_hard_links(group[key])
    lengths = {"N": info.ticks, "N+1": info.ticks + 1, "A": action_size(info.task)}
    for field in schema.FIELDS:
        if field.key in group:
            _check_dataset(group, field, lengths, file_bytes)
        elif not field.optional:
            raise DataError(f"{group.name} has no data set {field.key}")
    if lengths["D"] % 3:
        raise DataError(f"{group.name}/{schema.STATES} has {lengths['D']} columns; it must be three for each node")
    for key in (schema.RGB, schema.DEPTH):
        if (key in group[schema.OBS]) != (key in group[schema.NEXT_OBS]):
            raise DataError(f"{group.name} has {key} in only one of {schema.OBS} and {schema.NEXT_OBS}")
    return info


def read_demo(group: h5py.Group, *, images: bool) -> Episode:
    """The episode of a group that check_demo has passed."""
    attributes = typed_attributes(group, schema.DEMO_ATTRIBUTES)
    observations = _observations(group, images=images)
    truths = _truths(group)
    return Episode(
        task=cast(Task, attributes[schema.TASK]),
        cloth=str(attributes[schema.CLOTH]),
        seed=int(attributes[schema.SEED]),
        source=str(attributes[schema.SOURCE]),
        steps=_steps(group, observations, truths),
        final_observation=observations[-1],
        final_truth=truths[-1],
        stopped_by=cast(StoppedBy, attributes[schema.STOPPED_BY]),
        outcome=cast(Outcome, attributes[schema.OUTCOME]),
        tick_s=float(attributes[schema.TICK_S]),
        disturbance=str(attributes[schema.DISTURBANCE]),
        wall_s=float(attributes[schema.WALL_S]),
        start={key: float(value) for key, value in _json_object(attributes, schema.START).items()},
        provenance=_provenance(attributes),
    )


def _info(group: h5py.Group, attributes: Mapping[str, Attribute]) -> DemoInfo:
    allowed: dict[str, Sequence[Attribute]] = {
        schema.VERSION: (schema.SCHEMA_VERSION,),
        schema.ACTION_LIMIT: (ACTION_LIMIT_M,),
        schema.TASK: TASKS,
        schema.STOPPED_BY: STOPS,
        schema.OUTCOME: OUTCOMES,
        schema.SUCCESS: (attributes[schema.OUTCOME] == "success",),
    }
    for key, values in allowed.items():
        if attributes[key] not in values:
            raise DataError(
                f"attribute {key} of {group.name} is {attributes[key]!r}; it must be {', '.join(map(str, values))}"
            )
    ticks = int(attributes[schema.NUM_SAMPLES])
    if ticks < 1:
        raise DataError(f"attribute {schema.NUM_SAMPLES} of {group.name} is {ticks}; it must be at least 1")
    images = any(f"{schema.OBS}/{key}" in group for key in (schema.RGB, schema.DEPTH))
    return DemoInfo(
        uid=str(attributes[schema.UID]),
        task=cast(Task, attributes[schema.TASK]),
        cloth=str(attributes[schema.CLOTH]),
        tick_s=float(attributes[schema.TICK_S]),
        ticks=ticks,
        seed=int(attributes[schema.SEED]),
        source=str(attributes[schema.SOURCE]),
        outcome=cast(Outcome, attributes[schema.OUTCOME]),
        stopped_by=cast(StoppedBy, attributes[schema.STOPPED_BY]),
        disturbance=str(attributes[schema.DISTURBANCE]),
        wall_s=float(attributes[schema.WALL_S]),
        images=images,
    )


def _check_dataset(group: h5py.Group, field: schema.Field, lengths: dict[str, int], file_bytes: int) -> None:
    """``lengths`` binds the letters of a shape; new ones are added."""
    name = f"{group.name}/{field.key}"
    dataset = group[field.key]
    if not isinstance(dataset, h5py.Dataset):
        raise DataError(f"{name} is a group; it must be a data set")
    # Both kinds read from files that the session's author chose, on the machine of whoever opens it.
    if dataset.is_virtual or dataset.external:
        raise DataError(f"{name} keeps its data in another file; a session holds its data itself")
    if dataset.dtype.str != field.dtype:
        raise DataError(f"{name} is of type {dataset.dtype.str}; it must be {field.dtype}")
    shape = dataset.shape
    fits = shape is not None and len(shape) == len(field.shape)
    if fits:
        for wanted, got in zip(field.shape, shape, strict=True):
            fits = fits and got == (lengths.setdefault(wanted, got) if isinstance(wanted, str) else wanted)
    if not fits:
        known = tuple(lengths.get(w, w) if isinstance(w, str) else w for w in field.shape)
        raise DataError(f"{name} has shape {shape}; it must be {known}")
    claimed, stored = prod(shape) * dataset.dtype.itemsize, dataset.id.get_storage_size()
    if stored > file_bytes or claimed > stored * EXPANSION_MAX:
        raise DataError(f"{name} claims {claimed} bytes of which the file holds {stored}")


def _array(group: h5py.Group, key: str) -> NDArray[Any]:
    array: NDArray[Any] = group[key][()]
    return array


def _observations(group: h5py.Group, *, images: bool) -> list[Observation]:
    """All N + 1: those before each tick, and the last of next_obs."""
    rows: dict[str, NDArray[Any]] = {}
    for field in schema.OBSERVATION_FIELDS:
        key = f"{schema.OBS}/{field.key}"
        if field.optional and (not images or key not in group):
            continue
        last = group[f"{schema.NEXT_OBS}/{field.key}"][-1:]
        rows[field.key] = np.concatenate([_array(group, key), last])
    count = len(rows["time_s"])
    rgb, depth = rows.get(schema.RGB), rows.get(schema.DEPTH)
    return [
        Observation(
            time_s=float(rows["time_s"][i, 0]),
            corner_positions=rows["corner_positions"][i].reshape(2, 3),
            holder_position=rows["holder_position"][i],
            word=rows["word"][i],
            word_strength=float(rows["word_strength"][i, 0]),
            contact_portion=float(rows["contact_portion"][i, 0]),
            rgb=None if rgb is None else rgb[i],
            depth=None if depth is None else depth[i, ..., 0],
        )
        for i in range(count)
    ]


def _truths(group: h5py.Group) -> list[Truth]:
    states = np.concatenate([_array(group, schema.STATES), _array(group, schema.FINAL_STATE)[np.newaxis]])
    contact, area = _array(group, schema.CONTACT_TRUE), _array(group, schema.FLAT_AREA)
    return [
        Truth(nodes=row.reshape(-1, 3), contact_portion_true=float(contact[i, 0]), flat_area=float(area[i, 0]))
        for i, row in enumerate(states)
    ]


def _steps(group: h5py.Group, observations: list[Observation], truths: list[Truth]) -> tuple[Step, ...]:
    action_m, std = _array(group, schema.ACTION_M), _array(group, schema.ACTION_STD)
    if not np.array_equal(action_m / ACTION_LIMIT_M, _array(group, schema.ACTIONS)):
        raise DataError(f"{schema.ACTIONS} is not {schema.ACTION_M} / {ACTION_LIMIT_M}")
    phases = [bytes(phase).decode("ascii") for phase in _array(group, schema.PHASE)]
    return tuple(
        Step(
            observation=observations[i],
            truth=truths[i],
            action=action_m[i],
            action_std=None if np.isnan(std[i]).all() else std[i],
            phase=cast(Phase, phase),
        )
        for i, phase in enumerate(phases)
    )


def _json_object(attributes: Mapping[str, Attribute], key: str) -> dict[str, Any]:
    value = json.loads(str(attributes[key]))
    if not isinstance(value, dict):
        raise DataError(f"attribute {key} is {value!r}; it must be a JSON object")
    return value


def _provenance(attributes: Mapping[str, Attribute]) -> Provenance:
    value = _json_object(attributes, schema.PROVENANCE)
    versions = value["versions"]
    if not isinstance(versions, dict):
        raise DataError(f"versions in attribute {schema.PROVENANCE} is {versions!r}; it must be a JSON object")
    return Provenance(
        versions={key: str(version) for key, version in versions.items()},
        platform=str(value["platform"]),
        created_utc=str(value["created_utc"]),
        command=str(value["command"]),
    )
