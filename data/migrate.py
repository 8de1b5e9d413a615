"""Older versions of the schema, read as the present one.

Files are never changed by reading; whatever writes a session anew (appending, merging, repairing) writes the present
version. Version 1 (layflat 0.1) stored text at variable length, and knew neither descriptor, bench, joints,
disturbance_plan, first_tick and operator, nor the copies of contact and area among the attributes.
"""

from __future__ import annotations

from collections.abc import Mapping

import h5py

from data import schema
from data.attributes import Attribute

_NEW_IN_2 = (
    schema.DESCRIPTOR,
    schema.PLAN,
    schema.BENCH,
    schema.FIRST_TICK,
    schema.CONTACT_START,
    schema.CONTACT_FINAL,
    schema.CONTACT_TRUE_FINAL,
    schema.FLAT_AREA_FINAL,
)

SESSION_TYPES: Mapping[int, Mapping[str, type]] = {
    1: {k: t for k, t in schema.SESSION_ATTRIBUTES.items() if k not in (schema.DESCRIPTOR, schema.FRAMES)},
    2: schema.SESSION_ATTRIBUTES,
}
DEMO_TYPES: Mapping[int, Mapping[str, type]] = {
    1: {k: t for k, t in schema.DEMO_ATTRIBUTES.items() if k not in _NEW_IN_2},
    2: schema.DEMO_ATTRIBUTES,
}
"""Attributes by version; the data sets are the same, but for joints, which are optional."""
VERSIONS = tuple(DEMO_TYPES)


def upgraded_session(attributes: Mapping[str, Attribute]) -> dict[str, Attribute]:
    """Attributes of /data of any version in the terms of the present one."""
    return {schema.DESCRIPTOR: "word", **attributes}


def upgraded_demo(attributes: Mapping[str, Attribute], group: h5py.Group) -> dict[str, Attribute]:
    """Attributes of a demo of any version in the terms of the present one; its data sets must have been checked."""
    if attributes[schema.VERSION] == schema.SCHEMA_VERSION:
        return dict(attributes)
    contact = f"{schema.OBS}/contact_portion", f"{schema.NEXT_OBS}/contact_portion"
    return {
        **attributes,
        schema.VERSION: schema.SCHEMA_VERSION,
        schema.DESCRIPTOR: "word",
        schema.PLAN: "{}",
        schema.BENCH: "{}",
        schema.FIRST_TICK: 0,
        schema.CONTACT_START: float(group[contact[0]][0, 0]),
        schema.CONTACT_FINAL: float(group[contact[1]][-1, 0]),
        schema.CONTACT_TRUE_FINAL: float(group[schema.CONTACT_TRUE][-1, 0]),
        schema.FLAT_AREA_FINAL: float(group[schema.FLAT_AREA][-1, 0]),
    }
