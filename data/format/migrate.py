"""Older versions of the schema, read as the present one.

Files are never changed by reading; whatever writes a session anew (appending, merging, repairing) writes the present
version. Version 1 (layflat 0.1) stored text at variable length, and knew neither descriptor, bench, joints, plan of the
disturbance, first_step and operator, nor the copies of contact and area among the attributes. Version 2 (layflat 0.2)
knew one disturbance, whose steps only the phases tell, and neither forces, pulls nor interventions.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from layflat.data.format import schema
from layflat.data.format.attributes import Attribute, json_object
from layflat.data.format.encode import disturbances_text
from layflat.data.types import DisturbanceRecord

PLAN = "disturbance_plan"
"""JSON object among the attributes of version 2: what chance made of the disturbance."""
_NEW_IN_2 = (
    schema.DESCRIPTOR,
    PLAN,
    schema.SIM_CONFIG,
    schema.FIRST_STEP,
    schema.CONTACT_START,
    schema.CONTACT_FINAL,
    schema.CONTACT_TRUE_FINAL,
    schema.FLAT_AREA_FINAL,
)
_DEMO_TYPES_2 = {k: t for k, t in schema.DEMO_ATTRIBUTES.items() if k != schema.DISTURBANCES} | {PLAN: str}

SESSION_TYPES: Mapping[int, Mapping[str, type]] = {
    1: {k: t for k, t in schema.SESSION_ATTRIBUTES.items() if k not in (schema.DESCRIPTOR, schema.FRAMES)},
    2: schema.SESSION_ATTRIBUTES,
    3: schema.SESSION_ATTRIBUTES,
}
DEMO_TYPES: Mapping[int, Mapping[str, type]] = {
    1: {k: t for k, t in _DEMO_TYPES_2.items() if k not in _NEW_IN_2},
    2: _DEMO_TYPES_2,
    3: schema.DEMO_ATTRIBUTES,
}
"""Attributes by version; the data sets are the same, but for those that are optional."""
VERSIONS = tuple(DEMO_TYPES)
_OVER = ("converged", "threshold", "step_limit")
"""How an episode stops in which everything that began came to its end."""


def upgraded_session(attributes: Mapping[str, Attribute]) -> dict[str, Attribute]:
    """Attributes of /data of any version in the terms of the present one."""
    return {schema.DESCRIPTOR: "word", **attributes}


def upgraded_demo(attributes: Mapping[str, Attribute], group: h5py.Group) -> dict[str, Attribute]:
    """Attributes of a demo of any version in the terms of the present one; its data sets must have been checked."""
    if attributes[schema.VERSION] == schema.SCHEMA_VERSION:
        return dict(attributes)
    # Only a disturbed episode's phases are of interest, and opening a session should read no more than it must.
    phases = group[schema.PHASE][()] if attributes[schema.DISTURBANCE] != "none" else np.zeros(0, "|S8")
    if attributes[schema.VERSION] == 2:
        return from_2(attributes, phases)
    contact = f"{schema.OBS}/contact_portion", f"{schema.NEXT_OBS}/contact_portion"
    added: dict[str, Attribute] = {
        schema.DESCRIPTOR: "word",
        PLAN: "{}",
        schema.SIM_CONFIG: "{}",
        schema.FIRST_STEP: 0,
        schema.CONTACT_START: float(group[contact[0]][0, 0]),
        schema.CONTACT_FINAL: float(group[contact[1]][-1, 0]),
        schema.CONTACT_TRUE_FINAL: float(group[schema.CONTACT_TRUE][-1, 0]),
        schema.FLAT_AREA_FINAL: float(group[schema.FLAT_AREA][-1, 0]),
    }
    return from_2({**attributes, **added}, phases)


def from_2(attributes: Mapping[str, Attribute], phases: NDArray[Any]) -> dict[str, Attribute]:
    """Attributes of version 2 with the phases (N,) of its steps, as bytes."""
    there = {key: value for key, value in attributes.items() if key != PLAN}
    text = disturbances_from_2(attributes, phases)
    return {**there, schema.VERSION: schema.SCHEMA_VERSION, schema.DISTURBANCES: text}


def disturbances_from_2(attributes: Mapping[str, Attribute], phases: NDArray[Any]) -> str:
    """The one disturbance there was, as text; none where the episode ended before it."""
    n_steps = np.flatnonzero(phases == b"disturb")
    if attributes[schema.DISTURBANCE] == "none" or not n_steps.size:
        return json.dumps([])
    last = int(n_steps[-1])
    over = last + 1 < len(phases) or attributes[schema.STOPPED_BY] in _OVER
    record = DisturbanceRecord(
        name=str(attributes[schema.DISTURBANCE]),
        first_step=int(n_steps[0]),
        last_step=last if over else None,
        plan=json_object(attributes, PLAN),
    )
    return disturbances_text([record])
