"""Reads sessions: checks them first, and finds every kept episode also after a killed recording.

While a session is recorded, its newest episodes lie in files of their own in the folder ``FILE.h5.parts``; the recorder
moves them into ``FILE.h5``. A reader merges both in view and writes nothing, so that it may look on at any moment.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
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
from layflat.data.format.encode import AGREED
from layflat.data.format.migrate import upgraded_demo
from layflat.data.format.opening import FileGone, attribute_error_to, check_session, open_file, part_files
from layflat.data.format.structure_checks import check_demo, check_hard_link, stored_attributes, stored_digest
from layflat.data.robot import RobotSpec
from layflat.data.session.demo_info import DemoInfo
from layflat.data.session.index import IndexLine, read_index
from layflat.data.session.row_arrays import read_rows, stacked
from layflat.data.types import DisturbanceRecord, Episode, Outcome


def open_session(path: str | Path) -> Session:
    """The session at ``path``, to be closed or used with ``with``; DataError in one sentence where it is none.

    What is wrong with a single episode is said at the latest when that episode is read.
    """
    return Session(Path(path))


@dataclass(kw_only=True)
class _Demo:
    opened: h5py.File
    key: str
    """Its name in that file."""
    file: Path
    line: IndexLine
    checked: bool


class Session(Sequence[Episode]):
    """Recorded episodes of one robot with one cloth, oldest first: a sequence that reads each when it is asked for.

    ``session[3]``, ``session[-1]`` and ``session["demo_3"]`` are episodes, ``session[2:5]`` and ``session.view(names)``
    sequences of episodes that are read as late. Holds the file open until ``close``.
    """

    robot: RobotSpec
    cloth: str
    step_s: float
    """Simulated seconds of one step."""
    descriptor: str
    """What Observation.word was computed by."""

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

    @property
    def names(self) -> tuple[str, ...]:
        """demo_0, demo_1, ...: by number."""
        return tuple(self._demos)

    def info(self, name: str) -> DemoInfo:
        """Everything about an episode that needs no array."""
        return self._demo(name).line.info

    def infos(self) -> dict[str, DemoInfo]:
        """Of all episodes, by name."""
        return {name: demo.line.info for name, demo in self._demos.items()}

    def episode(self, name: str, *, images: bool = True) -> Episode:
        """One episode, read now; without images also where they were kept, if so asked."""
        with attribute_error_to(self._demo(name).file):
            return read_demo(self.group(name), images=images)

    def episodes(self, *, images: bool = True) -> Iterator[Episode]:
        """All in order, one in memory at a time."""
        return (self.episode(name, images=images) for name in self._demos)

    def disturbances(self, name: str) -> tuple[DisturbanceRecord, ...]:
        """What befell the cloth of an episode; its arrays are not read."""
        with attribute_error_to(self._demo(name).file):
            group = self.group(name)
            return disturbances_of(upgraded_demo(stored_attributes(group), group))

    def view(self, names: Sequence[str], *, images: bool = True) -> EpisodeView:
        """These episodes as a sequence; each is read when it is asked for."""
        for name in names:
            self._demo(name)
        return EpisodeView(self, tuple(names), images=images)

    def array(self, name: str, key: str, n_steps: slice = slice(None)) -> NDArray[Any]:
        """Rows of one data set of one episode, such as ``obs/word`` or ``action_m``; only those steps are read."""
        with attribute_error_to(self._demo(name).file):
            return read_rows(self.group(name), key, n_steps)

    def arrays(self, keys: Sequence[str], names: Sequence[str] | None = None) -> dict[str, NDArray[Any]]:
        """For learning: ``{key: (T, ...)}``, the steps of these episodes (all by default) one after another.

        Keys are data sets with one row per step (``obs/word``, ``next_obs/contact_portion``, ``action_m``, ``states``).
        Always there: ``episode`` (T,), position in ``names``, and ``step`` (T,) within the episode.
        """
        chosen = self.names if names is None else tuple(names)
        lengths = [self.info(name).n_steps for name in chosen]
        return stacked(keys, lengths, (partial(self.array, name) for name in chosen))

    def select(self, *, outcome: Outcome | None = None, source: str | None = None) -> tuple[str, ...]:
        """Names of the episodes with this outcome and source; None takes any."""
        return tuple(
            name
            for name, info in self.infos().items()
            if outcome in (None, info.outcome) and source in (None, info.source)
        )

    def group(self, name: str) -> h5py.Group:
        """The HDF5 group of an episode, checked against the schema."""
        demo = self._demo(name)
        with attribute_error_to(demo.file):
            data = demo.opened[schema.DATA]
            if not demo.checked:
                check_hard_link(data, demo.key)
                if check_demo(data[demo.key], file_bytes=demo.opened.id.get_filesize()) != demo.line.info:
                    raise DataError(f"{data.name}/{demo.key} does not agree with the file's index")
                demo.checked = True
            return data[demo.key]

    def groups(self) -> Iterator[tuple[str, h5py.Group]]:
        """Names and HDF5 groups, for whoever copies episodes without decoding them."""
        return ((name, self.group(name)) for name in self._demos)

    def lines(self) -> dict[str, IndexLine]:
        """What the index says, or would say, of each episode."""
        return {name: demo.line for name, demo in self._demos.items()}

    @property
    def main_file(self) -> h5py.File | None:
        """The session's own HDF5 file; None where all episodes still lie in parts."""
        return self._main

    @property
    def main_names(self) -> tuple[str, ...]:
        """Episodes that lie in the session's own file."""
        return tuple(name for name, demo in self._demos.items() if demo.opened is self._main)

    @property
    def indexed(self) -> bool:
        """Whether the session's own file has an index that fits."""
        return self._indexed

    def close(self) -> None:
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
        with attribute_error_to(self.path):
            real = self.path.resolve()
            files = part_files(real)
        # Parts before the file: a recorder removes a part only once the file holds it, so none can slip through.
        parts = self._open_parts(files)
        if real.exists():
            self._main = self._open.enter_context(open_file(self.path))
            self._indexed = self._add_all(self._main, self.path)
        elif not parts:
            raise DataError(f"{self.path} does not exist; record a session first or correct the path")
        taken = {demo.line.info.uid for demo in self._demos.values()}
        for file, opened in parts:
            self._add_all(opened, file, skip=taken)
        if parts:
            self._demos = dict(sorted(self._demos.items(), key=lambda item: schema.demo_number(item[0])))

    def _open_parts(self, files: list[Path]) -> list[tuple[Path, h5py.File]]:
        opened = []
        for file in files:
            with contextlib.suppress(FileGone):
                opened.append((file, self._open.enter_context(open_file(file))))
        return opened

    def _add_all(self, opened: h5py.File, file: Path, *, skip: set[str] | frozenset[str] = frozenset()) -> bool:
        """Take over the demos of one file, and say whether its index was of use.

        A number that is taken by another episode gives way to the next free one.
        """
        with attribute_error_to(file):
            session = check_session(opened)
            self._agree(session)
            size, data = opened.id.get_filesize(), opened[schema.DATA]
            names = sorted(data, key=_number)
            lines = read_index(opened, names, file_bytes=size)
            indexed = lines is not None
            if lines is None:
                lines = {name: _checked_line(data, name, size) for name in names}
            for name, line in lines.items():
                info = line.info
                if (info.robot, info.cloth, info.step_s, info.descriptor) != (
                    self.robot.name,
                    self.cloth,
                    self.step_s,
                    self.descriptor,
                ):
                    raise DataError(f"/{schema.DATA}/{name} is not of the session's robot, cloth, step and descriptor")
                if info.uid not in skip:
                    demo = _Demo(opened=opened, key=name, file=file, line=line, checked=not indexed)
                    self._demos[self._free(name)] = demo
            n_steps = sum(line.info.n_steps for line in lines.values())
            if n_steps != session[schema.TOTAL]:
                raise DataError(f"attribute {schema.TOTAL} is {session[schema.TOTAL]}; its demos have {n_steps} steps")
            return indexed

    def _agree(self, session: dict[str, Attribute]) -> None:
        agreed = tuple(session[key] for key in AGREED)
        if not hasattr(self, "robot"):
            self.robot = robot_of(session)
            self.task, self.physics = str(session[schema.TASK]), str(session[schema.PHYSICS])
            self.cloth, self.descriptor = str(session[schema.CLOTH]), str(session[schema.DESCRIPTOR])
            self.step_s = float(session[schema.STEP_S])
            self._agreed = agreed
        elif agreed != self._agreed:
            raise DataError(
                f"belongs to another session ({_described(agreed)}, not {_described(self._agreed)}); move it elsewhere"
            )

    def _free(self, name: str) -> str:
        if name not in self._demos:
            return name
        return schema.demo_name(1 + max(schema.demo_number(taken) for taken in self._demos))


class EpisodeView(Sequence[Episode]):
    """Some episodes of a session, each read when it is asked for; usable while the session is open."""

    def __init__(self, session: Session, names: tuple[str, ...], *, images: bool = True) -> None:
        self.names = names
        self._session = session
        self._images = images

    def infos(self) -> dict[str, DemoInfo]:
        """Of these episodes, by name."""
        return {name: self._session.info(name) for name in self.names}

    def arrays(self, keys: Sequence[str]) -> dict[str, NDArray[Any]]:
        """As Session.arrays, of these episodes."""
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


def _number(name: str) -> int:
    if not schema.DEMO_NAME.fullmatch(name):
        raise DataError(f"/{schema.DATA}/{name} is no demo; all members of /{schema.DATA} must be demo_<number>")
    return schema.demo_number(name)


def _checked_line(data: h5py.Group, name: str, file_bytes: int) -> IndexLine:
    check_hard_link(data, name)
    if not isinstance(data[name], h5py.Group):
        raise DataError(f"/{schema.DATA}/{name} is no demo; all members of /{schema.DATA} must be demo_<number>")
    info = check_demo(data[name], file_bytes=file_bytes)
    return IndexLine(info=info, digest=stored_digest(data[name]))


def _described(agreed: Sequence[object]) -> str:
    known = dict(zip(AGREED, agreed, strict=True))
    return ", ".join(f"{key} {known[key]}" for key in (schema.ROBOT, schema.CLOTH, schema.STEP_S, schema.DESCRIPTOR))
