"""Attributes of HDF5 groups as plain Python values, checked, with a checksum over them.

Text is stored at its length. Text of variable length, h5py's default, lies in HDF5's global heap, which has no
checksum: a few wrong bytes there keep the library in an endless loop.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any, TypeAlias, cast

import h5py
import numpy as np

from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.robot import RobotSpec

Attribute: TypeAlias = str | int | float | bool


def set_attribute(attributes: h5py.AttributeManager, key: str, value: Attribute) -> None:
    """Store a number as it is, text at its length."""
    if isinstance(value, str):
        text = value.encode("utf-8")
        attributes.create(key, text, dtype=h5py.string_dtype("utf-8", max(1, len(text))))
    else:
        attributes[key] = value


def typed_attributes(group: h5py.Group, types: Mapping[str, type]) -> dict[str, Attribute]:
    """Return the named attributes as plain Python values, or raise a DataError that says which one is wrong."""
    found: dict[str, Attribute] = {}
    attributes = group.attrs
    for key, wanted in types.items():
        try:
            stored = attributes.get_id(key)
        except KeyError:
            raise DataError(f"{group.name} has no attribute {key}") from None
        # Before reading: an array's shape is only a claim.
        if stored.shape != ():
            raise DataError(
                f"attribute {key} of {group.name} has shape {stored.shape}; it must be one {wanted.__name__}"
            )
        if _in_global_heap(stored.get_type()):
            raise DataError(f"attribute {key} of {group.name} is of variable length; it must be stored at its length")
        buffer = np.empty((), stored.dtype)
        stored.read(buffer)
        plain: Any = buffer.item()
        if isinstance(plain, bytes):
            plain = plain.decode("utf-8")
        if type(plain) is not wanted:
            raise DataError(f"attribute {key} of {group.name} is {type(plain).__name__}; it must be {wanted.__name__}")
        found[key] = cast(Attribute, plain)
    return found


def _in_global_heap(stored: h5py.h5t.TypeID) -> bool:
    if isinstance(stored, h5py.h5t.TypeStringID):
        return bool(stored.is_variable_str())
    return not isinstance(stored, h5py.h5t.TypeIntegerID | h5py.h5t.TypeFloatID | h5py.h5t.TypeEnumID)


def digest(attributes: Mapping[str, Attribute]) -> str:
    """Return the SHA-256 of the attributes' canonical JSON."""
    text = json.dumps(dict(attributes), sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def json_object(attributes: Mapping[str, Attribute], key: str) -> dict[str, Any]:
    """Return an attribute that holds a JSON object; DataError where it holds anything else."""
    value = _json(attributes, key)
    if not isinstance(value, dict):
        raise DataError(f"attribute {key} is {str(value)[:40]!r}; it must be a JSON object")
    return value


def json_objects(attributes: Mapping[str, Attribute], key: str) -> list[dict[str, Any]]:
    """Return an attribute that holds a JSON list of objects; DataError where it holds anything else."""
    value = _json(attributes, key)
    if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
        raise DataError(f"attribute {key} is {str(value)[:40]!r}; it must be a JSON list of objects")
    return value


def _json(attributes: Mapping[str, Attribute], key: str) -> Any:
    try:
        return json.loads(str(attributes[key]))
    except (ValueError, RecursionError):
        raise DataError(f"attribute {key} is {str(attributes[key])[:40]!r}; it must be JSON") from None


def robot_of(attributes: Mapping[str, Attribute]) -> RobotSpec:
    """Return the robot that the attributes name; DataError where it is damaged."""
    return RobotSpec.from_json(str(attributes[schema.ROBOT]), str(attributes[schema.ACTION_AXES]))
