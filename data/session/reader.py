"""Reads sessions: checks them first, and finds every saved episode also after a killed recording.

While a session is recorded, its newest episodes are in files of their own in the folder ``FILE.h5.parts``; the recorder
moves them into ``FILE.h5``. A reader shows both as one and writes nothing, so that it may look at any moment.
"""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, overload

import h5py
from numpy.typing import NDArray

from layflat.data.errors import DataError
from layflat.data.format import schema
from layflat.data.format.attributes import Attribute, robot_of
from layflat.data.format.decode import disturbances_of, read_demo
from layflat.data.format.demo_info import DemoInfo
from layflat.data.format.opening import FileGone, check_session, demo_names, errors_name, open_file
from layflat.data.format.rows import concatenated, read_rows
from layflat.data.format.structure_checks import check_demo, check_hard_link, stored_attributes
from layflat.data.robot import RobotSpec
from layflat.data.session.index import IndexRow, read_index, row_of
from layflat.data.session.parts import part_files
from layflat.data.types import DisturbanceRecord, Episode, Outcome


def open_session(path: str | Path) -> Session:
    """Open a recorded session for reading.

    Parameters
    ----------
    path : str or Path
        The session's ``.h5`` file.

    Returns
    -------
    Session
        A lazy sequence of episodes; close it, or use it in a ``with`` statement.

    Raises
    ------
    DataError
        If the file is not a session. An error in a single episode is raised at the latest when that episode is read.
    """
    return Session(Path(path))


@dataclass(kw_only=True)
class _Demo:
    opened: h5py.File
    key: str
    """Name of the demo in that file."""
    file: Path
    row: IndexRow
    checked: set[str]
    """Data sets that were checked against the schema."""


class Session(Sequence[Episode]):
    """A lazy sequence of recorded episodes of one robot with one cloth, oldest first.

    ``session[3]``, ``session[-1]`` and ``session["demo_3"]`` read one episode; ``session[2:5]`` and
    ``session.view(names)`` are sequences that read each episode when it is asked for. The file is open until `close`.

    Attributes
    ----------
    path : Path
        The session's file.
    robot : RobotSpec
        Robot of all episodes.
    task, physics, cloth, descriptor : str
        Names that all episodes share.
    step_s : float
        Simulated duration of one step in seconds.
    """

    robot: RobotSpec
    shared: dict[str, Attribute]
    """Attributes that all episodes share, by key of the schema."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._open = contextlib.ExitStack()
        self._demos: dict[str, _Demo] = {}
        self._main: h5py.File | None = None
        self._indexed = False
        try:
            self._load()
        except BaseException:
            self._open.close()
            raise
        self.task, self.physics = str(self.shared[schema.TASK]), str(self.shared[schema.PHYSICS])
        self.cloth, self.descriptor = str(self.shared[schema.CLOTH]), str(self.shared[schema.DESCRIPTOR])
        self.step_s = float(self.shared[schema.STEP_S])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the episodes by number: demo_0, demo_1, ..."""
        return tuple(self._demos)

    def info(self, name: str) -> DemoInfo:
        """Return everything about an episode that needs no array."""
        return self._demo(name).row.info

    def infos(self) -> dict[str, DemoInfo]:
        """Return the info of every episode by name; no array is read.

        Returns
        -------
        dict of str to DemoInfo
            Seed, outcome, number of steps, contact portions, ... by name.
        """
        return {name: demo.row.info for name, demo in self._demos.items()}

    def episode(self, name: str, *, images: bool = True) -> Episode:
        """Read one episode, with ``images`` False without rgb and depth."""
        with errors_name(self._demo(name).file):
            return read_demo(self.group(name), images=images)

    def episodes(self, *, images: bool = True) -> Iterator[Episode]:
        """Read all episodes in order, one in memory at a time."""
        return (self.episode(name, images=images) for name in self._demos)

    def disturbances(self, name: str) -> tuple[DisturbanceRecord, ...]:
        """Return the disturbances of an episode; its arrays are not read."""
        with errors_name(self._demo(name).file):
            return disturbances_of(stored_attributes(self.group(name)))

    def view(self, names: Sequence[str], *, images: bool = True) -> EpisodeView:
        """Return these episodes as a sequence that reads each when it is asked for."""
        for name in names:
            self._demo(name)
        return EpisodeView(self, tuple(names), images=images)

    def array(self, name: str, key: str, rows: slice = slice(None)) -> NDArray[Any]:
        """Read rows of one data set of one episode, such as ``obs/word`` or ``action_m``; only these rows are read."""
        if key not in schema.FIELDS:
            raise DataError(f"{key!r} is no data set of an episode; known ones are {', '.join(schema.FIELDS)}")
        with errors_name(self._demo(name).file):
            return read_rows(self._checked_group(name, (key,)), key, rows)

    def arrays(self, keys: Sequence[str], names: Sequence[str] | None = None) -> dict[str, NDArray[Any]]:
        """Read columns for learning: the steps of several episodes one after another.

        Parameters
        ----------
        keys : sequence of str
            Data sets with one row per step: ``obs/word``, ``next_obs/contact_portion``, ``action_m``, ``phase``,
            ``intervention``, ``states``, ... (docs/reference/session-file.md lists all of them with units and frames).
        names : sequence of str, optional
            Episodes by name; all by default.

        Returns
        -------
        dict of str to ndarray
            For each key an array (T, ...), T being the number of steps of all these episodes together. Always there:
            ``episode`` (T,), the position in ``names``, and ``step`` (T,), the step within the episode.

        Raises
        ------
        DataError
            If a key is unknown or has no row per step, or an episode is damaged or was recorded without it.
        """
        chosen = self.names if names is None else tuple(names)
        for key in keys:
            if key not in schema.STEP_KEYS:
                raise DataError(f"{key!r} has no row per step; those that have are {', '.join(schema.STEP_KEYS)}")
        lengths = [self.info(name).n_steps for name in chosen]
        for name in chosen:
            with errors_name(self._demo(name).file):
                self._checked_group(name, keys)
        return concatenated(keys, lengths, (partial(self.array, name) for name in chosen))

    def select(self, *, outcome: Outcome | None = None, source: str | None = None) -> tuple[str, ...]:
        """Return the names of the episodes with this outcome and source; None takes any."""
        return tuple(
            name
            for name, info in self.infos().items()
            if outcome in (None, info.outcome) and source in (None, info.source)
        )

    def group(self, name: str) -> h5py.Group:
        """Return the HDF5 group of an episode, checked against the schema."""
        with errors_name(self._demo(name).file):
            return self._checked_group(name, None)

    def _checked_group(self, name: str, keys: Collection[str] | None) -> h5py.Group:
        """Return the group of an episode after checking its attributes and these data sets, or all of them."""
        demo = self._demo(name)
        data, wanted = demo.opened[schema.DATA], set(schema.FIELDS if keys is None else keys) - demo.checked
        if wanted:
            check_hard_link(data, demo.key)
            size, group = demo.opened.id.get_filesize(), data[demo.key]
            if check_demo(group, file_bytes=size, keys=keys and wanted) != demo.row.info:
                raise DataError(f"{data.name}/{demo.key} does not agree with the file's index")
            demo.checked |= wanted
        return data[demo.key]

    def index_rows(self) -> dict[str, IndexRow]:
        """Return the row of each episode in the index, as it is or would be."""
        return {name: demo.row for name, demo in self._demos.items()}

    @property
    def main_file(self) -> h5py.File | None:
        """The session's own HDF5 file; None where all episodes are still in parts."""
        return self._main

    @property
    def main_names(self) -> tuple[str, ...]:
        """Names of the episodes in the session's own file."""
        return tuple(name for name, demo in self._demos.items() if demo.opened is self._main)

    @property
    def indexed(self) -> bool:
        """Whether the session's own file has a usable index."""
        return self._indexed

    def close(self) -> None:
        """Close the file."""
        self._open.close()

    def __len__(self) -> int:
        return len(self._demos)

    def __iter__(self) -> Iterator[Episode]:
        return self.episodes()

    def __contains__(self, name: object) -> bool:
        return name in self._demos

    @overload
    def __getitem__(self, which: int | str) -> Episode: ...
    @overload
    def __getitem__(self, which: slice) -> EpisodeView: ...
    def __getitem__(self, which: int | str | slice) -> Episode | EpisodeView:
        if isinstance(which, str):
            return self.episode(which)
        return EpisodeView(self, self.names)[which]

    def __enter__(self) -> Session:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _demo(self, name: str) -> _Demo:
        if name not in self._demos:
            known = f"{len(self)} from {self.names[0]} to {self.names[-1]}" if self._demos else "none"
            raise DataError(f"{self.path} has no episode {name!r}; it has {known}")
        return self._demos[name]

    def _load(self) -> None:
        with errors_name(self.path):
            real = self.path.resolve()
            files = part_files(real)
        # Parts before the file: a recorder removes a part only once the file holds it, so none can be missed.
        parts = self._open_parts(files)
        if real.exists():
            self._main = self._open.enter_context(open_file(self.path))
            self._indexed = self._add_all(self._main, self.path)
        elif not parts:
            raise DataError(f"{self.path} does not exist; record a session first or correct the path")
        known = {demo.row.info.uid for demo in self._demos.values()}
        for file, opened in parts:
            self._add_all(opened, file, skip=known)
        if parts:
            self._demos = dict(sorted(self._demos.items(), key=lambda item: schema.demo_number(item[0])))

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
                    demo = _Demo(
                        opened=opened, key=name, file=file, row=row, checked=set() if indexed else set(schema.FIELDS)
                    )
                    self._demos[self._free(name)] = demo
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
        if name not in self._demos:
            return name
        return schema.demo_name(1 + max(schema.demo_number(used) for used in self._demos))


class EpisodeView(Sequence[Episode]):
    """Some episodes of a session, each read when it is asked for; usable while the session is open."""

    def __init__(self, session: Session, names: tuple[str, ...], *, images: bool = True) -> None:
        self.names = names
        self._session = session
        self._images = images

    def infos(self) -> dict[str, DemoInfo]:
        """Return the info of these episodes by name."""
        return {name: self._session.info(name) for name in self.names}

    def arrays(self, keys: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Read columns of these episodes, as `Session.arrays` does."""
        return self._session.arrays(keys, self.names)

    def __len__(self) -> int:
        return len(self.names)

    @overload
    def __getitem__(self, which: int) -> Episode: ...
    @overload
    def __getitem__(self, which: slice) -> EpisodeView: ...
    def __getitem__(self, which: int | slice) -> Episode | EpisodeView:
        if isinstance(which, slice):
            return EpisodeView(self._session, self.names[which], images=self._images)
        return self._session.episode(self.names[which], images=self._images)


def differences(found: dict[str, Attribute], wanted: dict[str, Attribute]) -> str:
    """Return in words where shared attributes differ: "robot pickers, not hanger"."""
    return ", ".join(f"{key} {found[key]}, not {wanted[key]}" for key in wanted if found[key] != wanted[key])


def _checked_row(data: h5py.Group, name: str, file_bytes: int) -> IndexRow:
    check_hard_link(data, name)
    if not isinstance(data[name], h5py.Group):
        raise DataError(f"/{schema.DATA}/{name} is a data set; it must be a group")
    return row_of(data[name], file_bytes=file_bytes)
