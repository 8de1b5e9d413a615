"""Builds session files of demos: new ones, or those of another file, copied without decoding."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
from numpy.typing import NDArray

from layflat.data.errors import DataError, WriteError
from layflat.data.format import schema
from layflat.data.format.attributes import Attribute, digest, user_attributes
from layflat.data.format.content import CONTENT_KEYS, content_digest
from layflat.data.format.demo_info import DemoInfo, info_of
from layflat.data.format.encode import (
    LIBVER,
    arrays_of,
    attributes_of,
    describe_demo,
    write_demo,
    write_session_attributes,
)
from layflat.data.format.h5_writing import written_file
from layflat.data.format.masks import OWN_MASKS, masks_of, read_masks, write_masks
from layflat.data.format.measures import measures_of
from layflat.data.format.opening import open_file
from layflat.data.format.structure_checks import stored_attributes, stored_digest
from layflat.data.session.index import IndexRow, append_index
from layflat.data.system_errors import os_reason
from layflat.data.types import Episode


class SessionFile:
    """A session in a file that is open for writing and that no other process sees yet."""

    def __init__(
        self,
        file: h5py.File,
        existing: Mapping[str, IndexRow] | None = None,
        *,
        indexed: bool = False,
        check: Callable[[], None] = lambda: None,
    ) -> None:
        """Continue a file that has the demos ``existing``; ``indexed``: its index holds exactly these.

        ``check`` is called after each demo and raises an error where the disk is full.
        """
        self._file = file
        self._check = check
        self._data = file.require_group(schema.DATA)
        self._added: dict[str, IndexRow] = {}
        self._existing = dict(existing or {})
        self._indexed = indexed

    def copy(
        self, name: str, group: h5py.Group, info: DemoInfo, attributes: Mapping[str, Attribute] | None = None
    ) -> None:
        """Add a checked demo: its data sets byte by byte, its attributes by their checked values, or other ones."""
        attributes = stored_attributes(group) if attributes is None else attributes
        # HDF5 would read text from its global heap, which has no checksum.
        group.file.copy(group, self._data, name=name, without_attrs=True)
        self._check()
        copied = self._data[name]
        describe_demo(copied, attributes)
        for key, value in user_attributes(group).items():
            copied.attrs[key] = value
        self._describe(attributes)
        self._added[name] = _row(info, attributes, {key: group[key][()] for key in CONTENT_KEYS if key in group})

    def add(self, name: str, episode: Episode, uid: str, *, save_images: bool = True) -> None:
        """Add an episode."""
        self.write(name, attributes_of(episode, uid), arrays_of(episode, save_images=save_images))

    def write(
        self,
        name: str,
        attributes: Mapping[str, Attribute],
        arrays: Mapping[str, NDArray[Any]],
        users: Mapping[str, Any] | None = None,
    ) -> None:
        """Add an encoded episode, with the attributes that users have added."""
        group = self._data.create_group(name)
        write_demo(group, attributes, arrays)
        for key, value in (users or {}).items():
            group.attrs[key] = value
        self._check()
        self._describe(attributes)
        images = any(f"{schema.OBS}/{key}" in arrays for key in (schema.RGB, schema.DEPTH))
        info = info_of(attributes, images=images)
        self._added[name] = _row(info, attributes, arrays)

    def finish(self) -> None:
        """Write totals, masks and index; call once, after the last demo."""
        rows = self._existing | self._added
        self._data.attrs[schema.TOTAL] = sum(row.info.n_steps for row in rows.values())
        write_masks(self._file, masks_of({name: row.info.outcome for name, row in rows.items()}))
        if not self._indexed and schema.INDEX in self._file:
            del self._file[schema.INDEX]
        append_index(self._file, self._added if self._indexed else rows)

    def copy_masks(self, source: h5py.File, names: Mapping[str, str]) -> None:
        """Copy the users' masks of ``source`` with the names that demos have here (old -> new)."""
        masks = read_masks(source, file_bytes=source.id.get_filesize())
        for key, members in masks.items():
            if key not in OWN_MASKS:
                before = [name.decode() for name in self._file.get(f"{schema.MASK}/{key}", ())]
                here = [names[name] for name in members if name in names]
                write_masks(self._file, {key: [*before, *here]})

    def copy_extras(self, source: h5py.File, names: Mapping[str, str]) -> None:
        """Copy everything that users have added to ``source``: masks, groups, attributes of the session."""
        self.copy_masks(source, names)
        for key in source:
            if key not in (schema.DATA, schema.MASK, schema.INDEX):
                source.copy(key, self._file)
        for key, value in user_attributes(source[schema.DATA]).items():
            self._data.attrs[key] = value

    def _describe(self, attributes: Mapping[str, Attribute]) -> None:
        if schema.SCHEMA_NAME not in self._data.attrs:
            write_session_attributes(self._data, attributes, total=0)


def _row(info: DemoInfo, attributes: Mapping[str, Attribute], arrays: Mapping[str, NDArray[Any]]) -> IndexRow:
    return IndexRow(
        info=info,
        digest=digest(attributes),
        content=content_digest(arrays),
        measures=measures_of(attributes, arrays),
    )


def serialize(name: str, episode: Episode, uid: str, *, save_images: bool) -> bytes:
    """Return a session with this one episode as the bytes of a file.

    HDF5 writes to memory, because when a disk is full, its own closing fails half-way and leaves the file open.
    """
    attributes = attributes_of(episode, uid)
    arrays = arrays_of(episode, save_images=save_images)
    block = max(1 << 16, sum(array.nbytes for array in arrays.values()) // 8)
    with h5py.File("episode", "w", driver="core", backing_store=False, block_size=block, libver=LIBVER) as file:
        session = SessionFile(file)
        session.write(name, attributes, arrays)
        session.finish()
        file.flush()
        image: bytes = file.id.get_file_image()
    return image


def check_copy(copy: Path, digests: Mapping[str, str], names: Iterable[str]) -> None:
    """Read a new file before the files that it replaces are removed: it must hold all ``names``, with these digests."""
    with open_file(copy) as file:
        data = file[schema.DATA]
        copied = {name: stored_digest(data[name]) for name in digests}
        complete = set(data) == set(names)
    if copied != digests or not complete:
        raise DataError(f"{copy} does not hold what was written to it; the episodes stay where they are")


def check_writable(path: Path, real: Path) -> None:
    """Raise a DataError where a session cannot be written to ``real``."""
    if not real.parent.is_dir():
        problem = "is not a folder" if real.parent.exists() else "does not exist"
        raise DataError(f"{path} cannot be written: {real.parent} {problem}")
    if real.is_dir():
        raise DataError(f"{path} is a folder; name a file in it, such as {path / 'session.h5'}")
    if real.exists() and not real.is_file():
        raise DataError(f"{path} is not a regular file; choose another one")
    if real.exists() and not os.access(real, os.W_OK):
        raise DataError(f"{path} is write-protected; choose another file or allow writing")


@contextlib.contextmanager
def written_session(path: Path) -> Iterator[SessionFile]:
    """Yield a new session in a file of its own, finished when the block is left; OSError where the disk is full."""
    with written_file(path) as (file, check):
        session = SessionFile(file, check=check)
        yield session
        session.finish()


@contextlib.contextmanager
def write_errors(path: Path) -> Iterator[None]:
    """Raise errors of the file system as one sentence."""
    try:
        yield
    except (OSError, RuntimeError) as error:  # RuntimeError: HDF5, closing a file that it could not write in full.
        raise WriteError(
            f"{path} cannot be written: {os_reason(error)}; episodes that were saved before are safe"
        ) from error
