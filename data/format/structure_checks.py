"""Checks one demo of an untrusted file against the schema; reads attributes, not arrays."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from math import prod

import h5py

from layflat.data.camera import CameraModel
from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import Attribute, digest, robot_of, typed_attributes
from layflat.data.format.demo_info import DemoInfo, info_of
from layflat.data.types import ACTION_LIMIT_M, DESCRIPTORS, OUTCOMES, STOP_REASONS

EXPANSION_MAX = 1100
"""Bytes in memory per byte on disk: above deflate's limit of 1032. A small file that claims more is not believed."""
CHUNK_BYTES_MAX = 1 << 28
"""HDF5 unpacks a chunk as a whole; ours are of about a megabyte, a large image's its size."""
IMAGE_SIDES = (("H", "W"), ("H of depth", "W of depth"))
"""Letters of the heights and widths of rgb and depth in the schema."""
FILTERS = frozenset({h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32, h5py.h5z.FILTER_LZF})
"""Filters that come with h5py. For any other, HDF5 looks for a program library on this machine and runs it."""


@dataclass(frozen=True, kw_only=True)
class Violation:
    """One place where a file is not as the schema requires."""

    path: str
    """Path inside the file; attributes after an @, as in ``/data/demo_3@seed``."""
    message: str


class Violations(list[Violation]):
    """Collects violations: ``with found.at(path): check()`` adds a DataError to the list and continues."""

    @contextmanager
    def at(self, path: str) -> Iterator[None]:
        """Add a DataError of the block to the list."""
        try:
            yield
        except DataError as error:
            self.append(Violation(path=path, message=str(error)))


def check_demo(group: h5py.Group, *, file_bytes: int, keys: Collection[str] | None = None) -> DemoInfo:
    """Check names, types and shapes against the schema; DataError in one sentence where one is wrong.

    With ``keys`` only the attributes and these data sets are checked.
    """
    found = Violations()
    info = inspect_demo(group, found, file_bytes=file_bytes, keys=keys)
    if info is None:
        raise DataError(found[0].message)
    return info


def inspect_demo(
    group: h5py.Group, found: Violations, *, file_bytes: int, keys: Collection[str] | None = None
) -> DemoInfo | None:
    """Add everything that is wrong to ``found``; return the demo's info, or None where anything is wrong."""
    before, name = len(found), str(group.name)
    attributes = _attributes(group, found)
    if attributes is None:
        return None
    _inspect_values(group, attributes, found)
    _inspect_members(group, found, keys)
    if len(found) > before:
        return None
    n_steps, robot = int(attributes[schema.NUM_SAMPLES]), robot_of(attributes)
    lengths = {"N": n_steps, "N+1": n_steps + 1, "A": robot.size}
    for field in schema.FIELDS.values() if keys is None else [schema.FIELDS[key] for key in keys]:
        with found.at(f"{name}/{field.key}"):
            if field.key in group:
                _check_dataset(group[field.key], f"{name}/{field.key}", field, robot.hand_shape, lengths, file_bytes)
            elif not field.optional or (field in schema.GROUND_TRUTH_FIELDS and schema.FLAT_AREA_FINAL in attributes):
                raise DataError(f"{name} has no data set {field.key}")
    if len(found) == before and keys is None:
        _inspect_consistency(group, attributes, lengths, found)
    if len(found) > before:
        return None
    images = any(f"{schema.OBS}/{key}" in group for key in (schema.RGB, schema.DEPTH))
    return info_of(attributes, images=images)


def camera_of(attributes: Mapping[str, Attribute]) -> CameraModel | None:
    """Return the camera of an episode, or None where it is not known."""
    return CameraModel.from_json(str(attributes[schema.CAMERA])) if schema.CAMERA in attributes else None


def check_camera(camera: CameraModel | None, *sizes: tuple[int | None, int | None]) -> None:
    """Raise a DataError where an image has another height and width than those of the camera."""
    for height, width in sizes if camera is not None else ():
        if camera is not None and height is not None and (height, width) != (camera.height, camera.width):
            raise DataError(f"images are {width}x{height} px, but the camera has {camera.width}x{camera.height}")


def mesh_shape_of(attributes: Mapping[str, Attribute]) -> tuple[int, int] | None:
    """Return rows and columns of the cloth's nodes, or None where they are not known."""
    found = [int(attributes[key]) for key in (schema.MESH_ROWS, schema.MESH_COLUMNS) if key in attributes]
    if len(found) == 1:
        raise DataError(f"there must be {schema.MESH_ROWS} and {schema.MESH_COLUMNS}, or neither")
    return (found[0], found[1]) if found else None


def check_mesh(shape: tuple[int, int] | None, nodes: int | None) -> None:
    """Raise a DataError where a mesh of this shape cannot have so many nodes."""
    if shape is not None and (min(shape) < 1 or (nodes is not None and shape[0] * shape[1] != nodes)):
        raise DataError(f"the mesh has {shape[0]} x {shape[1]} nodes, but the states have {nodes}")


def stored_attributes(group: h5py.Group) -> dict[str, Attribute]:
    """Return the attributes of a demo once their checksum fits; DataError where one is wrong."""
    found = Violations()
    attributes = _attributes(group, found)
    if attributes is None:
        raise DataError(found[0].message)
    return attributes


def stored_digest(group: h5py.Group) -> str:
    """Return the checksum of the attributes of a checked demo."""
    return str(typed_attributes(group, {schema.DIGEST: str})[schema.DIGEST])


def check_hard_links(group: h5py.Group) -> None:
    """Raise a DataError where a member is a link, which may name another file of this machine."""
    for key in group:
        check_hard_link(group, key)


def inspect_links(group: h5py.Group, found: Violations) -> None:
    """Add every member that is a link to ``found``."""
    for key in group:
        with found.at(f"{group.name.rstrip('/')}/{key}"):
            check_hard_link(group, key)


def check_hard_link(group: h5py.Group, key: str) -> None:
    """Raise a DataError where a member is a link to elsewhere."""
    if group.id.links.get_info(key.encode("utf-8", "surrogateescape")).type != h5py.h5l.TYPE_HARD:
        raise DataError(f"{group.name.rstrip('/')}/{key} is a link to elsewhere; a session holds its data itself")


def check_stored_here(dataset: h5py.Dataset, name: str) -> None:
    """Make sure that reading opens no other file and runs no program library that the file's author chose."""
    properties = dataset.id.get_create_plist()
    if properties.get_layout() == h5py.h5d.VIRTUAL or properties.get_external_count():
        raise DataError(f"{name} keeps its data in another file; a session holds its data itself")
    strange = {properties.get_filter(i)[0] for i in range(properties.get_nfilters())} - FILTERS
    if strange:
        raise DataError(f"{name} is packed by filter {min(strange)}; only those that come with HDF5 are read")


def check_claim(dataset: h5py.Dataset, name: str, file_bytes: int) -> None:
    """Make sure that the file can hold what the shape says, before memory is allocated for it."""
    claimed, stored = prod(dataset.shape) * dataset.dtype.itemsize, dataset.id.get_storage_size()
    if stored > file_bytes or claimed > stored * EXPANSION_MAX:
        raise DataError(f"{name} claims {claimed} bytes of which the file holds {stored}")
    chunk = prod(dataset.chunks or ()) * dataset.dtype.itemsize
    if chunk > CHUNK_BYTES_MAX:
        raise DataError(f"{name} has chunks of {chunk} bytes; {CHUNK_BYTES_MAX} is the most that is read")


def _attributes(group: h5py.Group, found: Violations) -> dict[str, Attribute] | None:
    before, name = len(found), str(group.name)
    attributes: dict[str, Attribute] = {}
    wanted = {**schema.DEMO_ATTRIBUTES, schema.DIGEST: str}
    if not any(key in group.attrs for key in schema.GROUND_TRUTH_ATTRIBUTES):
        wanted = {key: kind for key, kind in wanted.items() if key not in schema.GROUND_TRUTH_ATTRIBUTES}
    wanted |= {key: kind for key, kind in schema.OPTIONAL_ATTRIBUTES.items() if key in group.attrs}
    try:
        attributes = typed_attributes(group, wanted)
    except DataError:
        for key, kind in wanted.items():
            with found.at(f"{name}@{key}"):
                typed_attributes(group, {key: kind})
    if len(found) > before:
        return None
    with found.at(f"{name}@{schema.DIGEST}"):
        if attributes.pop(schema.DIGEST) != digest(attributes):
            raise DataError(f"the attributes of {name} do not match their checksum")
        return attributes
    return None


def _inspect_values(group: h5py.Group, attributes: Mapping[str, Attribute], found: Violations) -> None:
    """Check attributes that may have few values only."""
    allowed: dict[str, Sequence[Attribute]] = {
        schema.VERSION: (schema.SCHEMA_VERSION,),
        schema.ACTION_LIMIT: (ACTION_LIMIT_M,),
        schema.STOPPED_BY: STOP_REASONS,
        schema.OUTCOME: OUTCOMES,
        schema.SUCCESS: (attributes[schema.OUTCOME] == "success",),
        schema.DESCRIPTOR: DESCRIPTORS,
    }
    wrong = {key: ", ".join(map(str, values)) for key, values in allowed.items() if attributes[key] not in values}
    for key, least in ((schema.NUM_SAMPLES, 1), (schema.FIRST_STEP, 0)):
        if int(attributes[key]) < least:
            wrong[key] = f"at least {least}"
    for key, right in wrong.items():
        with found.at(f"{group.name}@{key}"):
            raise DataError(f"attribute {key} of {group.name} is {attributes[key]!r}; it must be {right}")
    with found.at(f"{group.name}@{schema.ACTION_AXES}"):
        robot_of(attributes)


def _inspect_members(group: h5py.Group, found: Violations, keys: Collection[str] | None) -> None:
    before = len(found)
    inspect_links(group, found)
    if len(found) > before:
        return
    groups = (schema.OBS, schema.NEXT_OBS, schema.GROUND_TRUTH)
    for key in groups if keys is None else {key.rpartition("/")[0] for key in keys if "/" in key}:
        with found.at(f"{group.name}/{key}"):
            if key not in group and key == schema.GROUND_TRUTH:
                continue
            if key not in group or not isinstance(group[key], h5py.Group):
                raise DataError(f"{group.name} has no group {key}")
            inspect_links(group[key], found)


def _inspect_consistency(
    group: h5py.Group, attributes: Mapping[str, Attribute], lengths: Mapping[str, int], found: Violations
) -> None:
    """Check relations between data sets."""
    with found.at(f"{group.name}/{schema.STATES}"):
        if lengths.get("D", 0) % 3:
            raise DataError(f"{group.name}/{schema.STATES} has {lengths['D']} columns; it must be three for each node")
    with found.at(f"{group.name}@{schema.MESH_ROWS}"):
        check_mesh(mesh_shape_of(attributes), lengths["D"] // 3 if "D" in lengths else None)
    with found.at(f"{group.name}@{schema.CAMERA}"):
        check_camera(camera_of(attributes), *((lengths.get(h), lengths.get(w)) for h, w in IMAGE_SIDES))
    with found.at(f"{group.name}/{schema.GROUND_TRUTH}"):
        present = [field.key for field in schema.GROUND_TRUTH_FIELDS if field.key in group]
        if present and schema.FLAT_AREA_FINAL not in attributes:
            raise DataError(f"{group.name} has {present[0]} but no attribute {schema.FLAT_AREA_FINAL}")
    for key in (schema.RGB, schema.DEPTH):
        with found.at(f"{group.name}/{schema.OBS}/{key}"):
            if (key in group[schema.OBS]) != (key in group[schema.NEXT_OBS]):
                raise DataError(f"{group.name} has {key} in only one of {schema.OBS} and {schema.NEXT_OBS}")


def _check_dataset(
    dataset: h5py.Dataset,
    name: str,
    field: schema.Field,
    hand_shape: tuple[int, ...],
    lengths: dict[str, int],
    file_bytes: int,
) -> None:
    """Check a data set; ``lengths`` binds the letters of a shape, and new ones are added."""
    if not isinstance(dataset, h5py.Dataset):
        raise DataError(f"{name} is a group; it must be a data set")
    check_stored_here(dataset, name)
    if dataset.dtype.str != field.dtype:
        raise DataError(f"{name} is of type {dataset.dtype.str}; it must be {field.dtype}")
    shape = dataset.shape
    wanted = [n for part in field.shape for n in (hand_shape if part == schema.HAND_SHAPE else (part,))]
    if shape is None or len(shape) != len(wanted):
        raise DataError(f"{name} has shape {shape}; it must have {len(wanted)} dimensions")
    right = tuple(
        lengths.setdefault(part, got) if isinstance(part, str) else part
        for part, got in zip(wanted, shape, strict=True)
    )
    if shape != right:
        raise DataError(f"{name} has shape {shape}; it must be {right}")
    check_claim(dataset, name, file_bytes)
