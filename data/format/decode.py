"""Decodes rows and attributes to an episode: those of a checked demo, of a journal, of a foreign file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import Attribute, json_object, json_objects, robot_of
from layflat.data.format.rows import demo_rows
from layflat.data.format.structure_checks import camera_of, mesh_shape_of, stored_attributes
from layflat.data.types import (
    ACTION_LIMIT_M,
    DisturbanceRecord,
    DragTarget,
    Episode,
    GroundTruth,
    Observation,
    Outcome,
    Phase,
    Provenance,
    Step,
    StoppedBy,
)


def read_demo(group: h5py.Group, *, images: bool) -> Episode:
    """Return the episode of a group that check_demo has passed."""
    attributes, rows = stored_attributes(group), demo_rows(group, images=images)
    if not np.array_equal(rows[schema.ACTION_M] / ACTION_LIMIT_M, group[schema.ACTIONS][()]):
        raise DataError(f"{schema.ACTIONS} is not {schema.ACTION_M} / {ACTION_LIMIT_M}")
    for key, value in copied_attributes(rows).items():
        if attributes.get(key) != value:
            raise DataError(f"attribute {key} is {attributes.get(key)}; the arrays say {value}")
    return decode_episode(attributes, rows, group[schema.JOINTS][()] if schema.JOINTS in group else ())


def copied_attributes(rows: Mapping[str, NDArray[Any]]) -> dict[str, Attribute]:
    """Return the attributes that are copies from the arrays."""
    contact = rows["contact_portion"]
    copies = {schema.CONTACT_START: float(contact[0, 0]), schema.CONTACT_FINAL: float(contact[-1, 0])}
    if schema.STATES in rows:
        copies[schema.CONTACT_TRUE_FINAL] = float(rows[schema.CONTACT_TRUE][-1, 0])
        copies[schema.FLAT_AREA_FINAL] = float(rows[schema.FLAT_AREA][-1, 0])
    return dict(copies)


def decode_episode(
    attributes: Mapping[str, Attribute], rows: Mapping[str, NDArray[Any]], joints: ArrayLike = ()
) -> Episode:
    """Return the episode of a demo's attributes and of its rows by key, as demo_rows returns them.

    Data sets with a row per step may have one more, which is ignored: a journal has one record for each moment.
    """
    robot = robot_of(attributes)
    n_steps = len(rows["time_s"]) - 1
    observations = [_observation(rows, index) for index in range(n_steps + 1)]
    ground_truths = [_ground_truth(rows, index) for index in range(n_steps + 1)]
    return Episode(
        robot=robot,
        cloth=str(attributes[schema.CLOTH]),
        seed=int(attributes[schema.SEED]),
        source=str(attributes[schema.SOURCE]),
        steps=tuple(_step(rows, index, observations[index], ground_truths[index]) for index in range(n_steps)),
        final_observation=observations[-1],
        final_ground_truth=ground_truths[-1],
        stopped_by=cast(StoppedBy, attributes[schema.STOPPED_BY]),
        outcome=cast(Outcome, attributes[schema.OUTCOME]),
        task=str(attributes[schema.TASK]),
        physics=str(attributes[schema.PHYSICS]),
        step_s=float(attributes[schema.STEP_S]),
        disturbance=str(attributes[schema.DISTURBANCE]),
        wall_s=float(attributes[schema.WALL_S]),
        decision_s=None if (found := attributes.get(schema.DECISION_S)) is None else float(found),
        start={key: float(value) for key, value in json_object(attributes, schema.START).items()},
        provenance=_provenance(json_object(attributes, schema.PROVENANCE)),
        descriptor=str(attributes[schema.DESCRIPTOR]),
        sim_config=json_object(attributes, schema.SIM_CONFIG),
        initial_joints=np.array(joints, dtype=np.float64),
        disturbances=disturbances_of(attributes),
        first_step=int(attributes[schema.FIRST_STEP]),
        camera=camera_of(attributes),
        mesh_shape=mesh_shape_of(attributes),
    )


def disturbances_of(attributes: Mapping[str, Attribute]) -> tuple[DisturbanceRecord, ...]:
    """Return the disturbances of an episode."""
    return tuple(_disturbance(record) for record in json_objects(attributes, schema.DISTURBANCES))


def _disturbance(record: Mapping[str, Any]) -> DisturbanceRecord:
    name, first, last, plan = (record.get(key) for key in ("name", "first_step", "last_step", "plan"))
    typed = type(name) is str and type(first) is int and type(last) in (int, type(None)) and type(plan) is dict
    if not typed or len(record) != 4:
        raise DataError(
            f"attribute {schema.DISTURBANCES} holds {str(dict(record))[:80]!r}; each must have"
            " name, first_step, last_step and plan"
        )
    return DisturbanceRecord(**record)


def _observation(rows: Mapping[str, NDArray[Any]], index: int) -> Observation:
    rgb, depth = rows.get(schema.RGB), rows.get(schema.DEPTH)
    return Observation(
        time_s=float(rows["time_s"][index, 0]),
        corner_positions=rows["corner_positions"][index].reshape(2, 3),
        holder_position=rows["holder_position"][index],
        word=rows["word"][index],
        word_strength=float(rows["word_strength"][index, 0]),
        contact_portion=float(rows["contact_portion"][index, 0]),
        rgb=None if rgb is None else rgb[index],
        depth=None if depth is None else depth[index, ..., 0],
    )


def _ground_truth(rows: Mapping[str, NDArray[Any]], index: int) -> GroundTruth | None:
    if schema.STATES not in rows:
        return None
    return GroundTruth(
        nodes=rows[schema.STATES][index].reshape(-1, 3),
        contact_portion_true=float(rows[schema.CONTACT_TRUE][index, 0]),
        flat_area=float(rows[schema.FLAT_AREA][index, 0]),
    )


def _step(
    rows: Mapping[str, NDArray[Any]], index: int, observation: Observation, ground_truth: GroundTruth | None
) -> Step:
    std, node, hand = rows[schema.ACTION_STD][index], rows[schema.DRAG_NODE][index], rows[schema.HAND][index]
    return Step(
        observation=observation,
        ground_truth=ground_truth,
        action=rows[schema.ACTION_M][index],
        action_std=None if np.isnan(std).all() else std,
        phase=cast(Phase, bytes(rows[schema.PHASE][index]).decode("ascii", "replace")),
        drag=None if node == -1 else DragTarget(node=int(node), target_m=rows[schema.DRAG_TARGET][index]),
        force_n=rows[schema.FORCE][index],
        intervention=bool(rows[schema.INTERVENTION][index]),
        hand_m=None if np.isnan(hand).all() else hand,
    )


def _provenance(value: Mapping[str, Any]) -> Provenance:
    versions = value["versions"]
    if not isinstance(versions, dict):
        raise DataError(f"versions in attribute {schema.PROVENANCE} is {versions!r}; it must be a JSON object")
    return Provenance(
        versions={key: str(version) for key, version in versions.items()},
        platform=str(value["platform"]),
        created_utc=str(value["created_utc"]),
        command=str(value["command"]),
        operator=str(value["operator"]),
    )
