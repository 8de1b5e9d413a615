"""Opens session files that cannot be trusted; every error is one sentence that names the file."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from math import isclose
from pathlib import Path

import h5py

from layflat.data.atomic_files import is_locked
from layflat.data.errors import DataError
from layflat.data.format import schema, superblock
from layflat.data.format.attributes import Attribute, robot_of, typed_attributes
from layflat.data.format.structure_checks import check_hard_links
from layflat.data.open_elsewhere import writers_of
from layflat.data.system_errors import NO_LOCKS, errno_of, os_reason
from layflat.data.types import ACTION_LIMIT_M, DESCRIPTORS

DAMAGE = (OSError, RuntimeError, LookupError, TypeError, ValueError, ArithmeticError, AttributeError, MemoryError)
"""What h5py and numpy raise on bytes that make no sense."""
FOREIGN = "is an HDF5 file of another program; name a session that was recorded by layflat"


class FileError(DataError):
    """An error whose message already names the file."""


class FileGone(FileError):
    """A file that does not exist, or does not exist any more."""


class FileBusyError(FileError):
    """A file that another program has open for writing."""

    exit_status = 1
    """The call was right; it works when the other program is done."""


class FileMarkedError(FileError):
    """A file that a program has not closed, although none has it open any more, as far as can be seen."""


def open_file(path: Path) -> h5py.File:
    """Open an HDF5 file for reading; DataError in one sentence where it is none or cannot be read now."""
    if not path.is_file():
        if path.exists():
            raise DataError(f"{path} is not a file; name the session's .h5 file")
        raise FileGone(f"{path} does not exist")
    with errors_name(path):
        head = superblock.head_of(path)
        if not head.startswith(superblock.SIGNATURE):
            raise DataError("is not an HDF5 file; name a session that was recorded by layflat")
        try:
            return h5py.File(path, "r")
        except OSError as error:
            if isinstance(error, BlockingIOError):
                raise _busy(path) from None
            check_state(path)
            if "lock file" in str(error) and errno_of(error) in NO_LOCKS:
                return h5py.File(path, "r", locking=False)
            raise


def check_state(path: Path) -> None:
    """Raise an error where a program has, or had, the file open for writing; neither is damage."""
    marked = superblock.is_marked(superblock.head_of(path))
    if is_locked(path) or (marked and writers_of(path)):
        raise _busy(path)
    if marked:
        raise FileMarkedError(
            f"{path} is marked as open for writing, by a program that was killed or runs on another machine; close it"
            " there if it does, else `layflat data repair` removes the mark and checks every episode"
        )


def _busy(path: Path) -> FileBusyError:
    who = next((f" ({name}, process {pid})" for pid, name in writers_of(path).items()), "")
    return FileBusyError(f"{path} is open for writing in another program{who}; close it there")


def check_session(file: h5py.File) -> dict[str, Attribute]:
    """Return the attributes of /data; DataError where they are not those of a session of this version."""
    check_hard_links(file)
    data = file.get(schema.DATA)
    if not isinstance(data, h5py.Group) or schema.SCHEMA_NAME not in data.attrs or schema.VERSION not in data.attrs:
        raise DataError(FOREIGN)
    name = _schema_name(data)
    if name == schema.UNRELEASED_SCHEMA:
        raise DataError("is a session of an unreleased version of layflat, which cannot be read; record it again")
    if name != schema.SCHEMA:
        raise DataError(FOREIGN)
    version = int(typed_attributes(data, {schema.VERSION: int})[schema.VERSION])
    if version != schema.SCHEMA_VERSION:
        raise DataError(
            f"is written in version {version} of the format; this layflat reads version {schema.SCHEMA_VERSION}"
        )
    attributes = typed_attributes(data, schema.SESSION_ATTRIBUTES)
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


def _schema_name(data: h5py.Group) -> str:
    stored = data.attrs.get_id(schema.SCHEMA_NAME)
    kind, trusted = stored.get_type(), schema.TEXTS in data.attrs
    if not trusted and isinstance(kind, h5py.h5t.TypeStringID) and kind.is_variable_str():
        # The first unreleased version stored all text only so; reading it is avoided, see `schema.TEXTS`.
        return schema.UNRELEASED_SCHEMA
    return str(typed_attributes(data, {schema.SCHEMA_NAME: str})[schema.SCHEMA_NAME])


def demo_names(data: h5py.Group) -> list[str]:
    """Return the names of all members of /data by number; DataError where one is no demo."""
    for name in data:
        if not schema.DEMO_NAME.fullmatch(name):
            raise DataError(f"{data.name}/{name} is no demo; all members of {data.name} must be demo_<number>")
    return sorted(data, key=schema.demo_number)


@contextlib.contextmanager
def errors_name(path: Path) -> Iterator[None]:
    """Raise every error of reading as one sentence that names the file."""
    try:
        yield
    except FileError:
        raise
    except DataError as error:
        raise FileError(f"{path} {_joined(error)}") from error
    except FileNotFoundError as error:
        raise FileGone(f"{path} does not exist") from error
    except DAMAGE as error:
        if isinstance(error, OSError) and errno_of(error):
            raise FileError(f"{path} cannot be read: {os_reason(error)}") from error
        if isinstance(error, MemoryError):
            raise FileError(f"{path} cannot be read: there is not enough memory; close other programs") from error
        raise FileError(
            f"{path} is damaged or cut short ({first_line(error)}); use a copy, or `layflat data repair`, which saves"
            " the episodes that are intact"
        ) from error


def first_line(error: Exception) -> str:
    """Return the first line of an error's message, or the error's type where it has none."""
    return (str(error).splitlines() or [type(error).__name__])[0]


def _joined(error: DataError) -> str:
    """Return a sentence that continues after the file's name: "is ..." as it is, any other after a colon."""
    text = str(error)
    return text if text.startswith(("is ", "belongs ")) else f"cannot be used: {text}"
