"""Builds session files from demos: of another file, copied without decoding, or new ones."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import h5py
from numpy.typing import NDArray

from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import Attribute, digest
from layflat.data.format.decode import read_demo
from layflat.data.format.encode import LIBVER, arrays_of, attributes_of, write_demo, write_session_attributes
from layflat.data.format.masks import OURS, masks_of, read_masks, write_masks
from layflat.data.format.structure_checks import stored_attributes, stored_digest
from layflat.data.session.demo_info import DemoInfo, info_of
from layflat.data.session.index import IndexLine, append_index
from layflat.data.types import Episode


class SessionFile:
    """A session in the making in a file that is open for writing and that nobody else sees yet."""

    def __init__(self, file: h5py.File, there: Mapping[str, IndexLine] | None = None, *, indexed: bool = False) -> None:
        """``there``: demos that the file has already; ``indexed``: and exactly these are in its index."""
        self._file = file
        self._data = file.require_group(schema.DATA)
        self._lines: dict[str, IndexLine] = {}
        self._there = dict(there or {})
        self._indexed = indexed

    def copy(self, name: str, group: h5py.Group, info: DemoInfo) -> None:
        """A checked demo, byte by byte where it is of the present schema."""
        if info.version != schema.SCHEMA_VERSION:
            self.add(name, read_demo(group, images=True), info.uid)
            return
        group.file.copy(group, self._data, name=name)
        if schema.SCHEMA_NAME not in self._data.attrs:
            self._describe(stored_attributes(group))
        self._lines[name] = IndexLine(info=info, digest=stored_digest(group))

    def add(self, name: str, episode: Episode, uid: str, *, save_images: bool = True) -> None:
        """An episode."""
        self.write(name, attributes_of(episode, uid), arrays_of(episode, save_images=save_images))

    def write(self, name: str, attributes: Mapping[str, Attribute], arrays: Mapping[str, NDArray[Any]]) -> None:
        """An encoded episode."""
        write_demo(self._data.create_group(name), attributes, arrays)
        self._describe(attributes)
        images = any(f"{schema.OBS}/{key}" in arrays for key in (schema.RGB, schema.DEPTH))
        info = info_of(attributes, images=images, version=schema.SCHEMA_VERSION)
        self._lines[name] = IndexLine(info=info, digest=digest(attributes))

    def finish(self) -> None:
        """Totals, masks and index; call once, after the last demo."""
        lines = self._there | self._lines
        self._data.attrs[schema.TOTAL] = sum(line.info.n_steps for line in lines.values())
        write_masks(self._file, masks_of({name: line.info.outcome for name, line in lines.items()}))
        if not self._indexed and schema.INDEX in self._file:
            del self._file[schema.INDEX]
        append_index(self._file, self._lines if self._indexed else lines)

    def copy_extras(self, source: h5py.File, names: Mapping[str, str], *, masks_only: bool = False) -> None:
        """What users have added to ``source``; their masks with the names that demos have got here (old -> new)."""
        masks = read_masks(source, file_bytes=source.id.get_filesize())
        for key, members in masks.items():
            if key not in OURS:
                before = [name.decode() for name in self._file.get(f"{schema.MASK}/{key}", ())]
                here = [names[name] for name in members if name in names]
                write_masks(self._file, {key: [*before, *here]})
        if masks_only:
            return
        for key in source:
            if key not in (schema.DATA, schema.MASK, schema.INDEX):
                source.copy(key, self._file)
        for key in source[schema.DATA].attrs:
            if key not in self._data.attrs:
                self._data.attrs[key] = source[schema.DATA].attrs[key]

    def _describe(self, attributes: Mapping[str, Attribute]) -> None:
        if schema.SCHEMA_NAME not in self._data.attrs:
            write_session_attributes(self._data, attributes, total=0)


def serialize(name: str, episode: Episode, uid: str, *, save_images: bool) -> bytes:
    """A session with this one episode, as the bytes of a file.

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
    """Nothing is removed before what replaces it has been read: all ``names`` are there, with these checksums."""
    with h5py.File(copy, "r") as file:
        data = file[schema.DATA]
        copied = {name: stored_digest(data[name]) for name in digests}
        complete = set(data) == set(names)
    if copied != digests or not complete:
        raise DataError(f"{copy} does not hold what was written to it; the episodes stay where they are")
