"""Opens files of sessions that cannot be trusted; every error is one sentence that names the file."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from functools import partial
from math import isclose
from pathlib import Path

import h5py

from layflat.data.atomic_files import os_reason
from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import Attribute, robot_of, typed_attributes
from layflat.data.format.migrate import SESSION_TYPES, VERSIONS, upgraded_session
from layflat.data.format.structure_checks import check_hard_links
from layflat.data.tools.sandbox import CallOutcome, isolated
from layflat.data.types import ACTION_LIMIT_M, DESCRIPTORS

DAMAGE = (OSError, RuntimeError, LookupError, TypeError, ValueError, ArithmeticError, AttributeError, MemoryError)
"""What h5py and numpy raise on bytes that make no sense."""
PROBE_S, PROBE_BYTES = 60.0, 1 << 30


def parts_folder(path: Path) -> Path:
    """Where the episodes of the session at ``path`` lie until they are moved into it."""
    return path.with_name(path.name + ".parts")


def part_files(path: Path) -> list[Path]:
    """Finished single-episode files of the session at ``path``, in their numbers' order."""
    folder = parts_folder(path)
    if not folder.is_dir():
        return []
    files = [file for file in folder.glob("demo_*.h5") if schema.DEMO_NAME.fullmatch(file.stem)]
    return sorted(files, key=lambda file: schema.demo_number(file.stem))


class FileError(DataError):
    """Already names the file."""


class FileGone(FileError):
    """A file was there a moment ago."""


def open_file(path: Path) -> h5py.File:
    """An HDF5 file for reading; DataError in one sentence where it is none."""
    if not path.is_file():
        if path.exists():
            raise DataError(f"{path} is not a file; name the session's .h5 file")
        raise FileGone(f"{path} does not exist")
    with attribute_error_to(path):
        with path.open("rb") as file:
            head = file.read(8)
        if head != b"\x89HDF\r\n\x1a\n":
            raise DataError("is not an HDF5 file; name a session that was recorded by layflat")
        return h5py.File(path, "r")


def check_session(file: h5py.File) -> dict[str, Attribute]:
    """Attributes of /data in the present schema, once they say that the file is one of ours."""
    check_hard_links(file)
    data = file.get(schema.DATA)
    if not isinstance(data, h5py.Group) or schema.SCHEMA_NAME not in data.attrs or schema.VERSION not in data.attrs:
        raise DataError("is an HDF5 file of another program; name a session that was recorded by layflat")
    version = int(typed_attributes(data, {schema.VERSION: int})[schema.VERSION])
    if version not in VERSIONS:
        raise DataError(
            f"is written in version {version} of the format;"
            f" this layflat reads versions {VERSIONS[0]} to {VERSIONS[-1]}"
        )
    if version == 1:
        _probe(Path(file.filename))
    attributes = upgraded_session(typed_attributes(data, SESSION_TYPES[version], variable=version == 1))
    if attributes[schema.SCHEMA_NAME] != schema.SCHEMA:
        raise DataError("is an HDF5 file of another program; name a session that was recorded by layflat")
    robot_of(attributes)
    if attributes[schema.DESCRIPTOR] not in DESCRIPTORS:
        raise DataError(
            f"attribute descriptor is {attributes[schema.DESCRIPTOR]!r}; it must be one of {', '.join(DESCRIPTORS)}"
        )
    if not isclose(float(attributes[schema.ACTION_LIMIT]), ACTION_LIMIT_M):
        raise DataError(
            f"attribute {schema.ACTION_LIMIT} is {attributes[schema.ACTION_LIMIT]}; it must be {ACTION_LIMIT_M}"
        )
    return attributes


def _probe(path: Path) -> None:
    """Version 1 has its text in HDF5's global heap, where damage may keep the library in a loop: not here, then."""
    try:
        isolated(partial(_read_all_attributes, path), limit_s=PROBE_S, memory_bytes=PROBE_BYTES)
    except CallOutcome as error:
        raise DataError(f"is damaged (reading its attributes {error}); use a copy or record again") from None


def _read_all_attributes(path: Path) -> None:
    with h5py.File(path, "r") as file:
        data = file[schema.DATA]
        for group in (data, *(data[name] for name in data if isinstance(data.get(name, getlink=True), h5py.HardLink))):
            for key in group.attrs:
                group.attrs[key]


@contextlib.contextmanager
def attribute_error_to(path: Path) -> Iterator[None]:
    """Every error of reading as one sentence that names the file."""
    try:
        yield
    except FileError:
        raise
    except DataError as error:
        raise FileError(f"{path} {_joined(error)}") from error
    except FileNotFoundError as error:
        raise FileGone(f"{path} does not exist") from error
    except DAMAGE as error:
        if isinstance(error, OSError) and error.errno:
            raise FileError(f"{path} cannot be read: {os_reason(error)}") from error
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise FileError(f"{path} is damaged or cut short ({reason}); use a copy or record again") from error


def _joined(error: DataError) -> str:
    """'FILE is ...' reads on; any other sentence stands after a colon."""
    text = str(error)
    return text if text.startswith(("is ", "belongs ")) else f"cannot be used: {text}"
