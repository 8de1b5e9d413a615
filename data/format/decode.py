"""Makes an episode of a demo that has been checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

import h5py
import numpy as np
from numpy.typing import NDArray

from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import Attribute, json_object, json_objects, robot_of
from layflat.data.format.migrate import upgraded_demo
from layflat.data.format.structure_checks import stored_attributes
from layflat.data.session.row_arrays import read_rows
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

TOLD_BY_FEW = (schema.FORCE, schema.PULL_NODE, schema.PULL_TARGET, schema.INTERVENTION, schema.HAND)
"""Data sets of which most episodes have none."""


def read_demo(group: h5py.Group, *, images: bool) -> Episode:
    """The episode of a group that check_demo has passed."""
    attributes = upgraded_demo(stored_attributes(group), group)
    observations = _observations(group, images=images)
    ground_truths = _truths(group)
    _check_copies(attributes, observations, ground_truths)
    beginning = without_steps(attributes, observations[-1], ground_truths[-1])
    joints = group[schema.JOINTS][()] if schema.JOINTS in group else np.zeros(0)
    return replace(beginning, steps=_steps(group, observations, ground_truths), initial_joints=joints)


def without_steps(attributes: Mapping[str, Attribute], observation: Observation, ground_truth: GroundTruth) -> Episode:
    """Everything of an episode that the attributes of its demo hold."""
    provenance = json_object(attributes, schema.PROVENANCE)
    return Episode(
        robot=robot_of(attributes),
        cloth=str(attributes[schema.CLOTH]),
        seed=int(attributes[schema.SEED]),
        source=str(attributes[schema.SOURCE]),
        steps=(),
        final_observation=observation,
        final_ground_truth=ground_truth,
        stopped_by=cast(StoppedBy, attributes[schema.STOPPED_BY]),
        outcome=cast(Outcome, attributes[schema.OUTCOME]),
        task=str(attributes[schema.TASK]),
        physics=str(attributes[schema.PHYSICS]),
        step_s=float(attributes[schema.STEP_S]),
        disturbance=str(attributes[schema.DISTURBANCE]),
        wall_s=float(attributes[schema.WALL_S]),
        start={key: float(value) for key, value in json_object(attributes, schema.START).items()},
        provenance=_provenance(provenance),
        descriptor=str(attributes[schema.DESCRIPTOR]),
        sim_config=json_object(attributes, schema.SIM_CONFIG),
        disturbances=disturbances_of(attributes),
        first_step=int(attributes[schema.FIRST_STEP]),
    )


def disturbances_of(attributes: Mapping[str, Attribute]) -> tuple[DisturbanceRecord, ...]:
    """What befell the cloth."""
    return tuple(_disturbance(told) for told in json_objects(attributes, schema.DISTURBANCES))


def _disturbance(told: Mapping[str, Any]) -> DisturbanceRecord:
    name, first, last, plan = (told.get(key) for key in ("name", "first_step", "last_step", "plan"))
    known = type(name) is str and type(first) is int and type(last) in (int, type(None)) and type(plan) is dict
    if not known or len(told) != 4:
        raise DataError(
            f"attribute {schema.DISTURBANCES} holds {str(dict(told))[:80]!r}; each must have"
            " name, first_step, last_step and plan"
        )
    return DisturbanceRecord(**told)


def observations_of(rows: Mapping[str, NDArray[Any]]) -> list[Observation]:
    """From rows (N, ...) by observation key, as the data sets have them."""
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
        for i in range(len(rows["time_s"]))
    ]


def _observations(group: h5py.Group, *, images: bool) -> list[Observation]:
    """All N + 1: those before each step, and the last of next_obs."""
    rows: dict[str, NDArray[Any]] = {}
    for field in schema.OBSERVATION_FIELDS:
        key = f"{schema.OBS}/{field.key}"
        if field.optional and (not images or key not in group):
            continue
        last = group[f"{schema.NEXT_OBS}/{field.key}"][-1:]
        rows[field.key] = np.concatenate([_array(group, key), last])
    return observations_of(rows)


def _truths(group: h5py.Group) -> list[GroundTruth]:
    states = np.concatenate([_array(group, schema.STATES), _array(group, schema.FINAL_STATE)[np.newaxis]])
    contact, area = _array(group, schema.CONTACT_TRUE), _array(group, schema.FLAT_AREA)
    return [
        GroundTruth(nodes=row.reshape(-1, 3), contact_portion_true=float(contact[i, 0]), flat_area=float(area[i, 0]))
        for i, row in enumerate(states)
    ]


def _steps(group: h5py.Group, observations: list[Observation], ground_truths: list[GroundTruth]) -> tuple[Step, ...]:
    action_m, std = _array(group, schema.ACTION_M), _array(group, schema.ACTION_STD)
    if not np.array_equal(action_m / ACTION_LIMIT_M, _array(group, schema.ACTIONS)):
        raise DataError(f"{schema.ACTIONS} is not {schema.ACTION_M} / {ACTION_LIMIT_M}")
    phases = [bytes(phase).decode("ascii") for phase in _array(group, schema.PHASE)]
    forces, nodes, targets, taken, hands = (read_rows(group, key, slice(None)) for key in TOLD_BY_FEW)
    return tuple(
        Step(
            observation=observations[i],
            ground_truth=ground_truths[i],
            action=action_m[i],
            action_std=None if np.isnan(std[i]).all() else std[i],
            phase=cast(Phase, phase),
            drag=drag_of(nodes[i], targets[i]),
            force_n=forces[i],
            intervention=bool(taken[i]),
            hand_m=hand_of(hands[i]),
        )
        for i, phase in enumerate(phases)
    )


def drag_of(node: int, target_m: NDArray[np.float64]) -> DragTarget | None:
    """As the data sets have it: node -1 where nothing was pulled at."""
    return None if node == -1 else DragTarget(node=int(node), target_m=target_m)


def hand_of(row: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """As the data sets have it: NaN for the hands that were not there."""
    if np.isnan(row).all():
        return None
    return row[:3] if np.isnan(row[3:]).all() else row.reshape(2, 3)


def _check_copies(
    attributes: Mapping[str, Attribute], observations: list[Observation], ground_truths: list[GroundTruth]
) -> None:
    """What a table of episodes shows must be what the episodes hold."""
    for key, value in (
        (schema.CONTACT_START, observations[0].contact_portion),
        (schema.CONTACT_FINAL, observations[-1].contact_portion),
        (schema.CONTACT_TRUE_FINAL, ground_truths[-1].contact_portion_true),
        (schema.FLAT_AREA_FINAL, ground_truths[-1].flat_area),
    ):
        if attributes[key] != value:
            raise DataError(f"attribute {key} is {attributes[key]}; the arrays say {value}")


def _array(group: h5py.Group, key: str) -> NDArray[Any]:
    array: NDArray[Any] = group[key][()]
    return array


def _provenance(value: Mapping[str, Any]) -> Provenance:
    versions = value["versions"]
    if not isinstance(versions, dict):
        raise DataError(f"versions in attribute {schema.PROVENANCE} is {versions!r}; it must be a JSON object")
    return Provenance(
        versions={key: str(version) for key, version in versions.items()},
        platform=str(value["platform"]),
        created_utc=str(value["created_utc"]),
        command=str(value["command"]),
        operator=str(value.get("operator", "")),
    )
