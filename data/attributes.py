"""Attributes of HDF5 groups as plain Python values, checked, with a checksum over them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any, TypeAlias, cast

import h5py
import numpy as np

from data.types import DataError

Attribute: TypeAlias = str | int | float | bool


def typed_attributes(group: h5py.Group, types: Mapping[str, type]) -> dict[str, Attribute]:
    """The named attributes as plain Python values, or a DataError that says which one is wrong."""
    found: dict[str, Attribute] = {}
    attributes = group.attrs
    for key, wanted in types.items():
        try:
            shape = attributes.get_id(key).shape
        except KeyError:
            raise DataError(f"{group.name} has no attribute {key}") from None
        # Before reading: an array's shape is only a claim.
        if shape != ():
            raise DataError(f"attribute {key} of {group.name} has shape {shape}; it must be one {wanted.__name__}")
        value = attributes[key]
        plain: Any = value.item() if isinstance(value, np.generic) else value
        if type(plain) is not wanted:
            raise DataError(f"attribute {key} of {group.name} is {type(plain).__name__}; it must be {wanted.__name__}")
        found[key] = cast(Attribute, plain)
    return found


def digest(attributes: Mapping[str, Attribute]) -> str:
    """SHA-256 of the attributes' canonical JSON."""
    text = json.dumps(dict(attributes), sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def json_object(attributes: Mapping[str, Attribute], key: str) -> dict[str, Any]:
    """An attribute that holds a JSON object; DataError where it holds anything else."""
    try:
        value = json.loads(str(attributes[key]))
    except (ValueError, RecursionError):
        raise DataError(f"attribute {key} is {str(attributes[key])[:40]!r}; it must be JSON") from None
    if not isinstance(value, dict):
        raise DataError(f"attribute {key} is {str(value)[:40]!r}; it must be a JSON object")
    return value
