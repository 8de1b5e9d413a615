"""Attributes of HDF5 groups as plain Python values, checked, with a checksum over them.

Text is stored twice: of variable length for other programs, and at its length in `schema.TEXTS`, which is read here.
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
from layflat.data.sandbox import CallError, call_in_sandbox

Attribute: TypeAlias = str | int | float | bool
READ_S, READ_BYTES = 20.0, 1 << 28
"""Limits for reading attributes that other programs have written."""
_TEXT_TYPE = h5py.h5t.py_create(h5py.string_dtype(), logical=True)
_OWN_KEYS = frozenset(
    {*schema.SESSION_ATTRIBUTES, *schema.DEMO_ATTRIBUTES, *schema.OPTIONAL_ATTRIBUTES, *schema.DATASET_ATTRIBUTES}
    | {schema.DIGEST, schema.TEXTS, schema.ENV_ARGS}
)


def set_attributes(item: h5py.Group | h5py.Dataset, values: Mapping[str, Attribute]) -> None:
    """Store attributes of a new item: text of variable length, which other programs read as text."""
    space = h5py.h5s.create(h5py.h5s.SCALAR)
    for key, value in values.items():
        if isinstance(value, str):
            # Half the time of h5py's own way, which looks for an older attribute first.
            stored = h5py.h5a.create(item.id, key.encode(), _TEXT_TYPE, space)
            stored.write(np.array(value.encode(), dtype=h5py.string_dtype()))
        else:
            item.attrs[key] = value


def set_trusted_attributes(group: h5py.Group, values: Mapping[str, Attribute]) -> None:
    """Store attributes so that `typed_attributes` reads them back: all text once more at its length."""
    set_attributes(group, values)
    text = json.dumps({key: value for key, value in values.items() if isinstance(value, str)}).encode()
    group.attrs.create(schema.TEXTS, text, dtype=h5py.string_dtype("utf-8", len(text)))


def typed_attributes(group: h5py.Group, types: Mapping[str, type]) -> dict[str, Attribute]:
    """Return the named attributes as plain Python values, or raise a DataError that says which one is wrong."""
    found: dict[str, Attribute] = {}
    attributes, texts = group.attrs, _texts(group)
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
        if _in_global_heap(stored.get_type()) and key not in texts:
            raise DataError(
                f"attribute {key} of {group.name} is of variable length and not in {schema.TEXTS}; it cannot be trusted"
            )
        plain: Any = texts[key] if _in_global_heap(stored.get_type()) else _stored_value(stored)
        if type(plain) is not wanted:
            raise DataError(f"attribute {key} of {group.name} is {type(plain).__name__}; it must be {wanted.__name__}")
        found[key] = cast(Attribute, plain)
    return found


def texts_violations(group: h5py.Group) -> list[tuple[str, str]]:
    """Return key and fault of each text attribute that other programs read otherwise than this one.

    Damage may keep HDF5 in an endless loop: only for a sandbox.
    """
    found = []
    for key, text in _texts(group).items():
        seen = group.attrs.get(key)
        if seen != text and (not isinstance(seen, bytes) or seen.decode("utf-8", "replace") != text):
            found.append((key, f"attribute {key} is {str(seen)[:40]!r}, but {str(text)[:40]!r} in {schema.TEXTS}"))
    return found


def user_attributes(item: h5py.Group | h5py.Dataset) -> dict[str, Any]:
    """Return the attributes that users have added, read in a sandbox; none where they cannot be read."""
    keys = [key for key in item.attrs if key not in _OWN_KEYS]
    if not keys:
        return {}
    try:
        return call_in_sandbox(lambda: {key: item.attrs[key] for key in keys}, limit_s=READ_S, memory_bytes=READ_BYTES)
    except CallError:
        return {}


def _texts(group: h5py.Group) -> dict[str, Any]:
    """Return the text attributes as stored at their length; empty in a file of another program."""
    if schema.TEXTS not in group.attrs:
        return {}
    stored = group.attrs.get_id(schema.TEXTS)
    if stored.shape != () or _in_global_heap(stored.get_type()):
        raise DataError(f"attribute {schema.TEXTS} of {group.name} must be one text, stored at its length")
    return json_object({schema.TEXTS: cast(Attribute, _stored_value(stored))}, schema.TEXTS)


def _stored_value(stored: h5py.h5a.AttrID) -> object:
    buffer = np.empty((), stored.dtype)
    stored.read(buffer)
    plain = buffer.item()
    return plain.decode("utf-8") if isinstance(plain, bytes) else plain


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
