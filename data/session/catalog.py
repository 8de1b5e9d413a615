"""Catalog: the demos of a session's file and of its parts, each checked before it is used."""

from __future__ import annotations

import contextlib
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path

import h5py

from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import Attribute, robot_of
from layflat.data.format.content import CONTENT_KEYS, content_of_group
from layflat.data.format.measures import Measures, measures_of
from layflat.data.format.opening import FileGone, check_session, demo_names, errors_name, open_file
from layflat.data.format.structure_checks import check_demo, check_hard_link, stored_attributes
from layflat.data.robot import RobotSpec
from layflat.data.session.index import IndexRow, read_index, row_of
from layflat.data.session.parts import part_files


@dataclass(kw_only=True)
class CatalogEntry:
    """One demo."""

    opened: h5py.File
    key: str
    """Name of the demo in that file."""
    file: Path
    row: IndexRow
    checked: set[str]
    """Data sets that were checked against the schema."""


class Catalog:
    """All demos of a session by name; holds the files open until `close`."""

    robot: RobotSpec
    shared: dict[str, Attribute]
    """Attributes that all episodes share, by key of the schema."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.demos: dict[str, CatalogEntry] = {}
        self.main: h5py.File | None = None
        """The session's own file; None where all episodes are still in parts."""
        self.indexed = False
        """Whether the session's own file has a usable index."""
        self._open = contextlib.ExitStack()
        try:
            self._load()
        except BaseException:
            self.close()
            raise

    @property
    def main_names(self) -> tuple[str, ...]:
        """Names of the episodes in the session's own file."""
        return tuple(name for name, demo in self.demos.items() if demo.opened is self.main)

    def rows(self) -> dict[str, IndexRow]:
        """Return the row of each episode in the index, as it is or would be."""
        return {name: demo.row for name, demo in self.demos.items()}

    def entry(self, name: str) -> CatalogEntry:
        """Return a demo by name."""
        if name not in self.demos:
            names = tuple(self.demos)
            known = f"{len(names)} from {names[0]} to {names[-1]}" if names else "none"
            raise DataError(f"{self.path} has no episode {name!r}; it has {known}")
        return self.demos[name]

    def content(self, name: str) -> str:
        """Return the digest of the recorded content of an episode; its arrays are read only where no index has it."""
        demo = self.entry(name)
        if demo.row.content is None:
            with errors_name(demo.file):
                demo.row = replace(demo.row, content=content_of_group(self.group(name, CONTENT_KEYS)))
        return str(demo.row.content)

    def measures(self, name: str) -> Measures:
        """Return the measures of a recorded episode; its arrays are read only where no index has them."""
        demo = self.entry(name)
        found = demo.row.measures
        if found is None:
            with errors_name(demo.file):
                group = self.group(name, (schema.ACTIONS, schema.FINAL_STATE))
                arrays = {key: group[key][()] for key in (schema.ACTIONS, schema.FINAL_STATE) if key in group}
                found = measures_of(stored_attributes(group), arrays)
            demo.row = replace(demo.row, measures=found)
        return found

    def close(self) -> None:
        """Close all files."""
        self._open.close()

    def group(self, name: str, keys: Collection[str] | None = None) -> h5py.Group:
        """Return the group of an episode after checking its attributes and these data sets, or all of them."""
        demo = self.entry(name)
        data, wanted = demo.opened[schema.DATA], set(schema.FIELDS if keys is None else keys) - demo.checked
        if wanted:
            check_hard_link(data, demo.key)
            size, group = demo.opened.id.get_filesize(), data[demo.key]
            if check_demo(group, file_bytes=size, keys=keys and wanted) != demo.row.info:
                raise DataError(f"{data.name}/{demo.key} does not agree with the file's index")
            demo.checked |= wanted
        return data[demo.key]

    def _load(self) -> None:
        with errors_name(self.path):
            real = self.path.resolve()
            files = part_files(real)
        # Parts before the file: a recorder removes a part only once the file holds it, so none can be missed.
        parts = self._open_parts(files)
        if real.exists():
            self.main = self._open.enter_context(open_file(self.path))
            self.indexed = self._add_all(self.main, self.path)
        elif not parts:
            raise DataError(f"{self.path} does not exist; record a session first or correct the path")
        known = {demo.row.info.uid for demo in self.demos.values()}
        for file, opened in parts:
            self._add_all(opened, file, skip=known)
        if parts:
            self.demos = dict(sorted(self.demos.items(), key=lambda item: schema.demo_number(item[0])))

    def _open_parts(self, files: list[Path]) -> list[tuple[Path, h5py.File]]:
        opened = []
        for file in files:
            with contextlib.suppress(FileGone):
                opened.append((file, self._open.enter_context(open_file(file))))
        return opened

    def _add_all(self, opened: h5py.File, file: Path, *, skip: set[str] | frozenset[str] = frozenset()) -> bool:
        """Add the demos of one file and return whether its index was usable.

        A demo whose number another episode has gets the next free one.
        """
        with errors_name(file):
            session = check_session(opened)
            self._check_shared(session)
            size, data = opened.id.get_filesize(), opened[schema.DATA]
            names = demo_names(data)
            rows = read_index(opened, names, file_bytes=size)
            indexed = rows is not None
            if rows is None:
                rows = {name: _checked_row(data, name, size) for name in names}
            for name, row in rows.items():
                if row.info.shared != self.shared:
                    raise DataError(f"/{schema.DATA}/{name} is {differences(row.info.shared, self.shared)}")
                if row.info.uid not in skip:
                    demo = CatalogEntry(
                        opened=opened, key=name, file=file, row=row, checked=set() if indexed else set(schema.FIELDS)
                    )
                    self.demos[self._free(name)] = demo
            n_steps = sum(row.info.n_steps for row in rows.values())
            if n_steps != session[schema.TOTAL]:
                raise DataError(f"attribute {schema.TOTAL} is {session[schema.TOTAL]}; its demos have {n_steps} steps")
            return indexed

    def _check_shared(self, session: dict[str, Attribute]) -> None:
        shared = {key: session[key] for key in schema.SESSION_KEYS}
        if not hasattr(self, "shared"):
            self.robot, self.shared = robot_of(session), shared
        elif shared != self.shared:
            raise DataError(f"belongs to another session ({differences(shared, self.shared)}); move it elsewhere")

    def _free(self, name: str) -> str:
        if name not in self.demos:
            return name
        return schema.demo_name(1 + max(schema.demo_number(used) for used in self.demos))


def differences(found: dict[str, Attribute], wanted: dict[str, Attribute]) -> str:
    """Return in words where shared attributes differ: "robot pickers, not hanger"."""
    return ", ".join(f"{key} {found[key]}, not {wanted[key]}" for key in wanted if found[key] != wanted[key])


def _checked_row(data: h5py.Group, name: str, file_bytes: int) -> IndexRow:
    check_hard_link(data, name)
    if not isinstance(data[name], h5py.Group):
        raise DataError(f"/{schema.DATA}/{name} is a data set; it must be a group")
    return row_of(data[name], file_bytes=file_bytes)
