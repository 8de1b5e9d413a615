"""Checks one demo of a file that cannot be trusted against the schema; reads attributes, not arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import prod

import h5py

from data import schema
from data.attributes import Attribute, digest, typed_attributes
from data.info import DemoInfo, info_of
from data.migrate import DEMO_TYPES, VERSIONS, upgraded_demo
from data.types import ACTION_LIMIT_M, DESCRIPTORS, OUTCOMES, STOPS, TASKS, DataError, action_size

EXPANSION_MAX = 1100
"""Bytes in memory per byte on disk: above deflate's limit of 1032. A small file that claims more is not believed."""
CHUNK_BYTES_MAX = 1 << 28
"""HDF5 unpacks a chunk as a whole; ours are of about a megabyte, a large image's its size."""
FILTERS = frozenset({h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32, h5py.h5z.FILTER_LZF})
"""Those that come with h5py. For any other number HDF5 looks for a program library on this machine, and runs it."""


def check_hard_links(group: h5py.Group) -> None:
    """A link may name another file of this machine; a session needs none."""
    for key in group:
        check_hard_link(group, key)


def check_hard_link(group: h5py.Group, key: str) -> None:
    if not isinstance(group.get(key, getlink=True), h5py.HardLink):
        raise DataError(f"{group.name.rstrip('/')}/{key} is a link to elsewhere; a session holds its data itself")


def check_demo(group: h5py.Group, *, file_bytes: int) -> DemoInfo:
    """Names, types and shapes against the schema; DataError in one sentence where one is wrong."""
    attributes = stored_attributes(group)
    check_values(group, attributes)
    check_members(group)
    lengths = shape_letters(attributes)
    for field in schema.FIELDS:
        if field.key in group:
            check_dataset(group, field, lengths, file_bytes)
        elif not field.optional:
            raise DataError(f"{group.name} has no data set {field.key}")
    check_consistent(group, lengths)
    images = any(f"{schema.OBS}/{key}" in group for key in (schema.RGB, schema.DEPTH))
    return info_of(upgraded_demo(attributes, group), images=images, version=int(attributes[schema.VERSION]))


def stored_attributes(group: h5py.Group) -> dict[str, Attribute]:
    """Attributes as the file has them, in the version that it says, once their checksum fits."""
    version = int(typed_attributes(group, {schema.VERSION: int})[schema.VERSION])
    if version not in VERSIONS:
        raise DataError(f"attribute {schema.VERSION} of {group.name} is {version}; it must be one of {VERSIONS}")
    attributes = typed_attributes(group, DEMO_TYPES[version])
    if typed_attributes(group, {schema.DIGEST: str})[schema.DIGEST] != digest(attributes):
        raise DataError(f"the attributes of {group.name} do not match their checksum")
    return attributes


def check_values(group: h5py.Group, attributes: Mapping[str, Attribute]) -> None:
    """Attributes that only few values make sense for."""
    allowed: dict[str, Sequence[Attribute]] = {
        schema.ACTION_LIMIT: (ACTION_LIMIT_M,),
        schema.TASK: TASKS,
        schema.STOPPED_BY: STOPS,
        schema.OUTCOME: OUTCOMES,
        schema.SUCCESS: (attributes[schema.OUTCOME] == "success",),
        schema.DESCRIPTOR: DESCRIPTORS,
    }
    for key, values in allowed.items():
        if key in attributes and attributes[key] not in values:
            raise DataError(
                f"attribute {key} of {group.name} is {attributes[key]!r}; it must be {', '.join(map(str, values))}"
            )
    for key, least in ((schema.NUM_SAMPLES, 1), (schema.FIRST_TICK, 0)):
        if int(attributes.get(key, least)) < least:
            raise DataError(f"attribute {key} of {group.name} is {attributes[key]}; it must be at least {least}")


def check_members(group: h5py.Group) -> None:
    check_hard_links(group)
    for key in (schema.OBS, schema.NEXT_OBS, schema.TRUTH):
        if not isinstance(group.get(key), h5py.Group):
            raise DataError(f"{group.name} has no group {key}")
        check_hard_links(group[key])


def shape_letters(attributes: Mapping[str, Attribute]) -> dict[str, int]:
    """The lengths that the attributes decide on."""
    ticks, task = int(attributes[schema.NUM_SAMPLES]), next(t for t in TASKS if t == attributes[schema.TASK])
    return {"N": ticks, "N+1": ticks + 1, "A": action_size(task)}


def check_consistent(group: h5py.Group, lengths: Mapping[str, int]) -> None:
    """What lies between data sets."""
    if lengths["D"] % 3:
        raise DataError(f"{group.name}/{schema.STATES} has {lengths['D']} columns; it must be three for each node")
    for key in (schema.RGB, schema.DEPTH):
        if (key in group[schema.OBS]) != (key in group[schema.NEXT_OBS]):
            raise DataError(f"{group.name} has {key} in only one of {schema.OBS} and {schema.NEXT_OBS}")


def check_dataset(group: h5py.Group, field: schema.Field, lengths: dict[str, int], file_bytes: int) -> None:
    """``lengths`` binds the letters of a shape; new ones are added."""
    name = f"{group.name}/{field.key}"
    dataset = group[field.key]
    if not isinstance(dataset, h5py.Dataset):
        raise DataError(f"{name} is a group; it must be a data set")
    check_stored_here(dataset, name)
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
    check_claim(dataset, name, file_bytes)


def check_stored_here(dataset: h5py.Dataset, name: str) -> None:
    """Nothing outside of the file is read, and no program library that the file's author chose is run."""
    properties = dataset.id.get_create_plist()
    if properties.get_layout() == h5py.h5d.VIRTUAL or properties.get_external_count():
        raise DataError(f"{name} keeps its data in another file; a session holds its data itself")
    strange = {properties.get_filter(i)[0] for i in range(properties.get_nfilters())} - FILTERS
    if strange:
        raise DataError(f"{name} is packed by filter {min(strange)}; only those that come with HDF5 are read")


def check_claim(dataset: h5py.Dataset, name: str, file_bytes: int) -> None:
    """Whether the file can hold what the shape says, before room is made for it."""
    claimed, stored = prod(dataset.shape) * dataset.dtype.itemsize, dataset.id.get_storage_size()
    if stored > file_bytes or claimed > stored * EXPANSION_MAX:
        raise DataError(f"{name} claims {claimed} bytes of which the file holds {stored}")
    chunk = prod(dataset.chunks or ()) * dataset.dtype.itemsize
    if chunk > CHUNK_BYTES_MAX:
        raise DataError(f"{name} has chunks of {chunk} bytes; {CHUNK_BYTES_MAX} is the most that is read")
