"""Checks one demo of a file that cannot be trusted against the schema; reads attributes, not arrays."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from math import prod

import h5py

from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import Attribute, digest, robot_of, typed_attributes
from layflat.data.format.migrate import DEMO_TYPES, VERSIONS, upgraded_demo
from layflat.data.session.demo_info import DemoInfo, info_of
from layflat.data.types import ACTION_LIMIT_M, DESCRIPTORS, OUTCOMES, STOP_REASONS

EXPANSION_MAX = 1100
"""Bytes in memory per byte on disk: above deflate's limit of 1032. A small file that claims more is not believed."""
CHUNK_BYTES_MAX = 1 << 28
"""HDF5 unpacks a chunk as a whole; ours are of about a megabyte, a large image's its size."""
FILTERS = frozenset({h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32, h5py.h5z.FILTER_LZF})
"""Those that come with h5py. For any other number HDF5 looks for a program library on this machine, and runs it."""


@dataclass(frozen=True, kw_only=True)
class Violation:
    """Where a file is not what the schema says, and how."""

    path: str
    """Inside the file; attributes after an @, as in ``/data/demo_3@seed``."""
    sentence: str


class Violations(list[Violation]):
    """Collects what is wrong: ``with found.at(path): check()`` takes note of a DataError and goes on."""

    @contextmanager
    def at(self, path: str) -> Iterator[None]:
        try:
            yield
        except DataError as error:
            self.append(Violation(path=path, sentence=str(error)))


def check_demo(group: h5py.Group, *, file_bytes: int) -> DemoInfo:
    """Names, types and shapes against the schema; DataError in one sentence where one is wrong."""
    found = Violations()
    info = inspect_demo(group, found, file_bytes=file_bytes)
    if info is None:
        raise DataError(found[0].sentence)
    return info


def inspect_demo(group: h5py.Group, found: Violations, *, file_bytes: int) -> DemoInfo | None:
    """As check_demo, but adds everything that is wrong to ``found``; None where anything is."""
    before = len(found)
    attributes = _attributes(group, found)
    if attributes is None:
        return None
    _inspect_values(group, attributes, found)
    _inspect_members(group, found)
    if len(found) > before:
        return None
    lengths, name = _lengths(attributes), str(group.name)
    groups = {"": group} | {key: group[key] for key in (schema.OBS, schema.NEXT_OBS, schema.TRUTH)}
    for field in schema.FIELDS:
        parent, _, key = field.key.rpartition("/")
        with found.at(f"{name}/{field.key}"):
            if key in groups[parent]:
                _check_dataset(groups[parent][key], f"{name}/{field.key}", field, lengths, file_bytes)
            elif not field.optional:
                raise DataError(f"{name} has no data set {field.key}")
    if len(found) == before:
        _inspect_consistency(group, lengths, found)
    if len(found) > before:
        return None
    images = any(f"{schema.OBS}/{key}" in group for key in (schema.RGB, schema.DEPTH))
    return info_of(upgraded_demo(attributes, group), images=images, version=int(attributes[schema.VERSION]))


def stored_attributes(group: h5py.Group) -> dict[str, Attribute]:
    """Attributes as the file has them, in the version that it says, once their checksum fits."""
    found = Violations()
    attributes = _attributes(group, found)
    if attributes is None:
        raise DataError(found[0].sentence)
    return attributes


def stored_digest(group: h5py.Group) -> str:
    """Checksum of the attributes of a checked demo, as the file has it."""
    version = typed_attributes(group, {schema.VERSION: int})[schema.VERSION]
    return str(typed_attributes(group, {schema.DIGEST: str}, variable=version == 1)[schema.DIGEST])


def check_hard_links(group: h5py.Group) -> None:
    """A link may name another file of this machine; a session needs none."""
    for key in group:
        check_hard_link(group, key)


def inspect_links(group: h5py.Group, found: Violations) -> None:
    """As check_hard_links, of every link that is wrong."""
    for key in group:
        with found.at(f"{group.name.rstrip('/')}/{key}"):
            check_hard_link(group, key)


def check_hard_link(group: h5py.Group, key: str) -> None:
    if group.id.links.get_info(key.encode("utf-8", "surrogateescape")).type != h5py.h5l.TYPE_HARD:
        raise DataError(f"{group.name.rstrip('/')}/{key} is a link to elsewhere; a session holds its data itself")


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


def _attributes(group: h5py.Group, found: Violations) -> dict[str, Attribute] | None:
    before = len(found)
    attributes: dict[str, Attribute] = {}
    with found.at(f"{group.name}@{schema.VERSION}"):
        version = int(typed_attributes(group, {schema.VERSION: int})[schema.VERSION])
        of_session = typed_attributes(group.parent, {schema.VERSION: int})[schema.VERSION]
        if version not in VERSIONS or version != of_session:
            raise DataError(f"attribute {schema.VERSION} of {group.name} is {version}; the session's is {of_session}")
        name = str(group.name)
        for key, wanted in {**DEMO_TYPES[version], schema.DIGEST: str}.items():
            with found.at(f"{name}@{key}"):
                attributes |= typed_attributes(group, {key: wanted}, variable=version == 1)
    if len(found) > before:
        return None
    with found.at(f"{group.name}@{schema.DIGEST}"):
        if attributes.pop(schema.DIGEST) != digest(attributes):
            raise DataError(f"the attributes of {group.name} do not match their checksum")
        return attributes
    return None


def _inspect_values(group: h5py.Group, attributes: Mapping[str, Attribute], found: Violations) -> None:
    """Attributes that only few values make sense for."""
    allowed: dict[str, Sequence[Attribute]] = {
        schema.ACTION_LIMIT: (ACTION_LIMIT_M,),
        schema.STOPPED_BY: STOP_REASONS,
        schema.OUTCOME: OUTCOMES,
        schema.SUCCESS: (attributes[schema.OUTCOME] == "success",),
        schema.DESCRIPTOR: DESCRIPTORS,
    }
    wrong = {
        key: ", ".join(map(str, v)) for key, v in allowed.items() if key in attributes and attributes[key] not in v
    }
    for key, least in ((schema.NUM_SAMPLES, 1), (schema.FIRST_STEP, 0)):
        if int(attributes.get(key, least)) < least:
            wrong[key] = f"at least {least}"
    for key, right in wrong.items():
        with found.at(f"{group.name}@{key}"):
            raise DataError(f"attribute {key} of {group.name} is {attributes[key]!r}; it must be {right}")


def _inspect_members(group: h5py.Group, found: Violations) -> None:
    before = len(found)
    inspect_links(group, found)
    if len(found) > before:
        return
    for key in (schema.OBS, schema.NEXT_OBS, schema.TRUTH):
        with found.at(f"{group.name}/{key}"):
            if key not in group or not isinstance(group[key], h5py.Group):
                raise DataError(f"{group.name} has no group {key}")
            inspect_links(group[key], found)


def _lengths(attributes: Mapping[str, Attribute]) -> dict[str, int]:
    """The letters of shapes that the attributes decide on."""
    n_steps = int(attributes[schema.NUM_SAMPLES])
    return {"N": n_steps, "N+1": n_steps + 1, "A": robot_of(attributes).size}


def _inspect_consistency(group: h5py.Group, lengths: Mapping[str, int], found: Violations) -> None:
    """What lies between data sets."""
    with found.at(f"{group.name}/{schema.STATES}"):
        if lengths["D"] % 3:
            raise DataError(f"{group.name}/{schema.STATES} has {lengths['D']} columns; it must be three for each node")
    for key in (schema.RGB, schema.DEPTH):
        with found.at(f"{group.name}/{schema.OBS}/{key}"):
            if (key in group[schema.OBS]) != (key in group[schema.NEXT_OBS]):
                raise DataError(f"{group.name} has {key} in only one of {schema.OBS} and {schema.NEXT_OBS}")


def _check_dataset(
    dataset: h5py.Dataset, name: str, field: schema.Field, lengths: dict[str, int], file_bytes: int
) -> None:
    """``lengths`` binds the letters of a shape; new ones are added."""
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
