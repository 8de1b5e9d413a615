"""Reads sessions: checks them first, and finds every kept episode also after a killed recording.

While a session is recorded, its newest episodes lie in files of their own in the folder ``FILE.h5.parts``; the recorder
moves them into ``FILE.h5``. A reader merges both in view and writes nothing, so that it may look on at any moment.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from math import isclose
from pathlib import Path
from types import TracebackType
from typing import cast

import h5py

from data import schema
from data.decode import DemoInfo, check_demo, check_hard_links, read_demo, typed_attributes
from data.durable import os_reason
from data.types import ACTION_LIMIT_M, TASKS, DataError, Episode, Outcome, Task

_DAMAGE = (OSError, RuntimeError, LookupError, TypeError, ValueError, ArithmeticError, AttributeError, MemoryError)
"""What h5py and numpy raise on bytes that make no sense."""


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


def open_session(path: str | Path) -> Session:
    """The session at ``path``, checked against the schema; DataError in one sentence where it is none."""
    return Session(Path(path))


@dataclass(frozen=True, kw_only=True)
class _Demo:
    group: h5py.Group
    file: Path
    info: DemoInfo


class Session:
    """Recorded episodes of one task with one cloth, oldest first. Holds the file open until ``close``."""

    task: Task
    cloth: str
    tick_s: float
    """Simulated seconds of one tick."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._open = contextlib.ExitStack()
        self._demos: dict[str, _Demo] = {}
        self._main: h5py.File | None = None
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
        return self._demo(name).info

    def episode(self, name: str, *, images: bool = True) -> Episode:
        """One episode, read now; without images also where they were kept, if so asked."""
        demo = self._demo(name)
        with _blaming(demo.file):
            return read_demo(demo.group, images=images)

    def episodes(self, *, images: bool = True) -> Iterator[Episode]:
        """All in order, one in memory at a time."""
        return (self.episode(name, images=images) for name in self._demos)

    def select(self, *, outcome: Outcome | None = None, source: str | None = None) -> tuple[str, ...]:
        """Names of the episodes with this outcome and source; None takes any."""
        return tuple(
            name
            for name, demo in self._demos.items()
            if outcome in (None, demo.info.outcome) and source in (None, demo.info.source)
        )

    def groups(self) -> Iterator[tuple[str, h5py.Group]]:
        """Names and HDF5 groups, for whoever copies episodes without decoding them."""
        return ((name, demo.group) for name, demo in self._demos.items())

    @property
    def main_file(self) -> h5py.File | None:
        """The session's own HDF5 file; None where all episodes still lie in parts."""
        return self._main

    def close(self) -> None:
        self._open.close()

    def __len__(self) -> int:
        return len(self._demos)

    def __iter__(self) -> Iterator[Episode]:
        return self.episodes()

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
        with _blaming(self.path):
            real = self.path.resolve()
            files = part_files(real)
        # Parts before the file: a recorder removes a part only once the file holds it, so none can slip through.
        parts = self._open_parts(files)
        if real.exists():
            self._main = self._open.enter_context(_open_file(self.path))
            self._add_all(self._main, self.path)
        elif not parts:
            raise DataError(f"{self.path} does not exist; record a session first or correct the path")
        taken = {demo.info.uid for demo in self._demos.values()}
        for file, opened in parts:
            self._add_all(opened, file, skip=taken)
        self._demos = dict(sorted(self._demos.items(), key=lambda item: schema.demo_number(item[0])))

    def _open_parts(self, files: list[Path]) -> list[tuple[Path, h5py.File]]:
        opened = []
        for file in files:
            with contextlib.suppress(_Vanished):
                opened.append((file, self._open.enter_context(_open_file(file))))
        return opened

    def _add_all(self, opened: h5py.File, file: Path, *, skip: set[str] | frozenset[str] = frozenset()) -> None:
        """Take over the demos of one file; a number that is taken by another episode gives way to the next free one."""
        with _blaming(file):
            session = _check_session(opened)
            agreed = (session[schema.TASK], session[schema.CLOTH], session[schema.TICK_S])
            if not hasattr(self, "task"):
                self.task, self.cloth, self.tick_s = cast(Task, agreed[0]), str(agreed[1]), float(agreed[2])
            elif agreed != (self.task, self.cloth, self.tick_s):
                raise DataError(
                    f"belongs to another session ({_described(*agreed)}, not"
                    f" {_described(self.task, self.cloth, self.tick_s)}); move it elsewhere"
                )
            size, data, ticks = opened.id.get_filesize(), opened[schema.DATA], 0
            for name in sorted(data, key=schema.demo_number):
                info = check_demo(data[name], file_bytes=size)
                ticks += info.ticks
                if (info.task, info.cloth, info.tick_s) != agreed:
                    raise DataError(f"{data[name].name} is not of the session's task, cloth and tick")
                if info.uid not in skip:
                    self._demos[self._free(name)] = _Demo(group=data[name], file=file, info=info)
            if ticks != session[schema.TOTAL]:
                raise DataError(f"attribute {schema.TOTAL} is {session[schema.TOTAL]}; its demos have {ticks} ticks")

    def _free(self, name: str) -> str:
        if name not in self._demos:
            return name
        return schema.demo_name(1 + max(schema.demo_number(taken) for taken in self._demos))


class _Vanished(DataError):
    """A file was there a moment ago."""


def _open_file(path: Path) -> h5py.File:
    if not path.is_file():
        if path.exists():
            raise DataError(f"{path} is not a file; name the session's .h5 file")
        raise _Vanished(f"{path} does not exist")
    with _blaming(path):
        with path.open("rb") as file:
            head = file.read(8)
        if head != b"\x89HDF\r\n\x1a\n":
            raise DataError("is not an HDF5 file; name a session that was recorded by layflat")
        return h5py.File(path, "r")


def _check_session(file: h5py.File) -> dict[str, str | int | float | bool]:
    """Attributes of /data, once they say that the file is one of ours and of this schema."""
    check_hard_links(file)
    data = file.get(schema.DATA)
    if not isinstance(data, h5py.Group) or data.attrs.get(schema.SCHEMA_NAME) != schema.SCHEMA:
        raise DataError("is an HDF5 file of another program; name a session that was recorded by layflat")
    version = typed_attributes(data, {schema.VERSION: int})[schema.VERSION]
    if version != schema.SCHEMA_VERSION:
        raise DataError(
            f"is written in version {version} of the format; this layflat reads version {schema.SCHEMA_VERSION}"
        )
    attributes = typed_attributes(data, schema.SESSION_ATTRIBUTES)
    if attributes[schema.TASK] not in TASKS:
        raise DataError(f"attribute task is {attributes[schema.TASK]!r}; it must be one of {', '.join(TASKS)}")
    if not isclose(float(attributes[schema.ACTION_LIMIT]), ACTION_LIMIT_M):
        raise DataError(
            f"attribute {schema.ACTION_LIMIT} is {attributes[schema.ACTION_LIMIT]}; it must be {ACTION_LIMIT_M}"
        )
    check_hard_links(data)
    for name in data:
        if not schema.DEMO_NAME.fullmatch(name) or not isinstance(data[name], h5py.Group):
            raise DataError(f"/{schema.DATA}/{name} is no demo; all members of /{schema.DATA} must be demo_<number>")
    return attributes


def _described(task: object, cloth: object, tick_s: object) -> str:
    return f"task {task}, cloth {cloth}, tick {tick_s} s"


@contextlib.contextmanager
def _blaming(path: Path) -> Iterator[None]:
    """Every error of reading as one sentence that names the file."""
    try:
        yield
    except DataError as error:
        raise DataError(f"{path} {_joined(error)}") from error
    except FileNotFoundError as error:
        raise _Vanished(f"{path} does not exist") from error
    except _DAMAGE as error:
        if isinstance(error, OSError) and error.errno:
            raise DataError(f"{path} cannot be read: {os_reason(error)}") from error
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise DataError(f"{path} is damaged or cut short ({reason}); use a copy or record again") from error


def _joined(error: DataError) -> str:
    """'FILE is ...' reads on; any other sentence stands after a colon."""
    text = str(error)
    return text if text.startswith(("is ", "belongs ")) else f"cannot be used: {text}"
