"""Writes sessions, so that an episode that was reported as kept survives whatever happens next.

The only copy of an episode is never inside a file that is open for writing. ``keep`` makes each a finished file of its
own in ``FILE.h5.parts``; from time to time, and on closing, ``FILE.h5`` is made anew from itself and these, written
aside and renamed, and only then are the parts removed. Readers see every kept episode in between, too (``data.store``);
after a killed recording the next recorder tidies up.
"""

from __future__ import annotations

import contextlib
import os
import uuid
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import h5py

from data import schema
from data.durable import PART_SUFFIX, WriterLock, fsync_path, os_reason, write_durably, written_aside
from data.encode import LIBVER, arrays_of, attributes_of, write_demo, write_masks, write_session_attributes
from data.store import Session, open_session, part_files, parts_folder
from data.types import TASKS, DataError, Episode, Task

PARTS_MAX = 64
"""Parts that are let lie at most: each costs a reader an open file."""


@dataclass(frozen=True, kw_only=True)
class KeptEpisode:
    """Where a durable episode is found."""

    name: str
    """demo_<int>: its name in the session."""
    path: Path
    """The session's file."""
    ticks: int
    size_bytes: int


class SessionRecorder:
    """The one writer of a session. Appends where the file is there and agrees in task, cloth, tick and schema."""

    def __init__(self, path: str | Path, *, task: Task, cloth: str, keep_images: bool = False) -> None:
        """Finds out now whether ``path`` can be written, before time goes into episodes; DataError where not."""
        if task not in TASKS:
            raise DataError(f"task is {task!r}; it must be one of {', '.join(TASKS)}")
        self.path = Path(path)
        self.task: Task = task
        self.cloth = cloth
        self.keep_images = keep_images
        self._next = 0
        self._tick_s: float | None = None
        self._closed = False
        with _writing(self.path):
            self._real = self.path.resolve()
            self._parts = parts_folder(self._real)
            _check_place(self.path, self._real)
            self._lock = WriterLock(self._parts, self.path)
        try:
            self._take_over()
        except BaseException:
            self._lock.release()
            raise

    def keep(self, episode: Episode) -> KeptEpisode:
        """Returns once the episode is durable; a DataError means that it was not kept and that all others are safe."""
        if self._closed:
            raise DataError(f"{self.path} is closed; open a new recorder")
        self._check_fits(episode)
        image = _file_image(episode, self._next, keep_images=self.keep_images)
        name = schema.demo_name(self._next)
        with _writing(self.path):
            write_durably(self._parts / f"{name}.h5", image)
        self._next += 1
        self._tick_s = episode.tick_s
        # The episode is safe already; should there be no room to assemble, its part stays until there is.
        with contextlib.suppress(DataError, OSError):
            if self._worth_assembling():
                self._assemble()
        return KeptEpisode(name=name, path=self.path, ticks=len(episode.steps), size_bytes=len(image))

    def close(self) -> None:
        """Put everything into the one file. If that fails, the parts stay, and readers still find all episodes."""
        if self._closed:
            return
        self._closed = True
        try:
            if part_files(self._real):
                self._assemble()
        finally:
            self._lock.release()

    def __enter__(self) -> SessionRecorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _take_over(self) -> None:
        """Check what is there, and finish what a killed recorder left."""
        with _writing(self.path):
            for stale in self._parts.glob(f"*{PART_SUFFIX}"):
                stale.unlink()
            fsync_path(self._real.parent)
        parts = part_files(self._real)
        if not parts and not self._real.exists():
            return
        with open_session(self.path) as session:
            for key, there, wanted in (("task", session.task, self.task), ("cloth", session.cloth, self.cloth)):
                if there != wanted:
                    raise DataError(f"{self.path} holds episodes with {key} {there}, not {wanted}; choose another file")
            self._tick_s = session.tick_s
            self._next = 1 + max((schema.demo_number(name) for name in session.names), default=-1)
        if parts:
            self._assemble()

    def _check_fits(self, episode: Episode) -> None:
        for key, wanted, got in (
            ("task", self.task, episode.task),
            ("cloth", self.cloth, episode.cloth),
            ("tick_s", self._tick_s, episode.tick_s),
        ):
            if wanted is not None and got != wanted:
                raise DataError(f"the episode's {key} is {got}; all episodes of {self.path} have {wanted}")
        if not episode.tick_s > 0:
            raise DataError(f"the episode's tick_s is {episode.tick_s}; it must be above 0")

    def _worth_assembling(self) -> bool:
        """When the parts weigh as much as the file: so that all copying together stays in proportion to the data."""
        parts = part_files(self._real)
        assembled = self._real.stat().st_size if self._real.exists() else 0
        return len(parts) >= PARTS_MAX or sum(part.stat().st_size for part in parts) >= assembled

    def _assemble(self) -> None:
        with _writing(self.path):
            aside = self._parts / f"session.h5{PART_SUFFIX}"
            with written_aside(self._real, aside), open_session(self.path) as session:
                _copy_session(session, aside)
                _check_copy(session, aside)
            for part in part_files(self._real):
                part.unlink()


def _check_place(path: Path, real: Path) -> None:
    """What mkdir would not say in plain words, or not to root."""
    if not real.parent.is_dir():
        problem = "is not a folder" if real.parent.exists() else "does not exist"
        raise DataError(f"{path} cannot be written: {real.parent} {problem}")
    if real.is_dir():
        raise DataError(f"{path} is a folder; name a file in it, such as {path / 'session.h5'}")
    if real.exists() and not real.is_file():
        raise DataError(f"{path} is not a regular file; choose another one")
    if real.exists() and not os.access(real, os.W_OK):
        raise DataError(f"{path} is write-protected; choose another file or allow writing")


def _file_image(episode: Episode, number: int, *, keep_images: bool) -> bytes:
    """A session with this one episode, as the bytes of a file.

    HDF5 writes to memory, because when a disk is full, its own closing fails half-way and leaves the file open.
    """
    attributes = attributes_of(episode, uuid.uuid4().hex)
    arrays = arrays_of(episode, keep_images=keep_images)
    block = max(1 << 16, sum(array.nbytes for array in arrays.values()) // 8)
    with h5py.File("episode", "w", driver="core", backing_store=False, block_size=block, libver=LIBVER) as file:
        data = file.create_group(schema.DATA)
        write_demo(data.create_group(schema.demo_name(number)), attributes, arrays)
        write_session_attributes(data, attributes, total=len(episode.steps))
        write_masks(file, {schema.demo_name(number): episode.outcome})
        file.flush()
        image: bytes = file.id.get_file_image()
    return image


def _copy_session(session: Session, target: Path) -> None:
    """All episodes of the merged view, and whatever else users have added to the file, into a new file."""
    with h5py.File(target, "x", libver=LIBVER) as file:
        data = file.create_group(schema.DATA)
        old = session.main_file
        if old is not None:
            for key in old:
                if key != schema.DATA:
                    old.copy(key, file)
            for key, value in old[schema.DATA].attrs.items():
                data.attrs[key] = value
        for name, group in session.groups():
            group.file.copy(group, data, name=name)
            if schema.ENV_ARGS not in data.attrs:
                write_session_attributes(data, dict(group.attrs), total=0)
        data.attrs[schema.TOTAL] = sum(session.info(name).ticks for name in session.names)
        write_masks(file, {name: session.info(name).outcome for name in session.names})


def _check_copy(session: Session, copy: Path) -> None:
    """Nothing is removed before what replaces it has been read."""
    with h5py.File(copy, "r") as file:
        copied = {name: demo.attrs[schema.DIGEST] for name, demo in file[schema.DATA].items()}
    if copied != {name: group.attrs[schema.DIGEST] for name, group in session.groups()}:
        raise DataError(f"{copy} does not hold what was written to it; the episodes stay where they are")


@contextlib.contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Errors of the file system as one sentence."""
    try:
        yield
    except (OSError, RuntimeError) as error:  # RuntimeError: HDF5, closing a file that it could not write in full.
        raise DataError(
            f"{path} cannot be written: {os_reason(error)}; episodes that were kept before are safe"
        ) from error
