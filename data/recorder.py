"""Writes sessions, so that an episode that was reported as kept survives whatever happens next.

The only copy of an episode is never inside a file that is open for writing. ``keep`` makes each a finished file of its
own in ``FILE.h5.parts``; from time to time, and on closing, ``FILE.h5`` is made anew from itself and these, written
aside and renamed, and only then are the parts removed. Readers see every kept episode in between, too (``data.store``);
after a killed recording the next recorder tidies up.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import uuid
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import h5py

from data import schema
from data.assemble import SessionFile, check_copy, file_image
from data.durable import PART_SUFFIX, WriterLock, fsync_path, os_reason, write_durably, written_aside
from data.encode import LIBVER
from data.opening import part_files, parts_folder
from data.store import Session, open_session
from data.types import DESCRIPTORS, TASKS, DataError, Episode, Task

PARTS_MAX = 200
"""Parts that are let lie at most: each costs a reader an open file, of which a process may have 256 on some systems."""


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
    """The one writer of a session. Appends where the file is there and agrees in task, cloth, tick and descriptor."""

    def __init__(
        self, path: str | Path, *, task: Task, cloth: str, keep_images: bool = False, descriptor: str = "word"
    ) -> None:
        """Finds out now whether ``path`` can be written, before time goes into episodes; DataError where not."""
        for key, value, known in (("task", task, TASKS), ("descriptor", descriptor, DESCRIPTORS)):
            if value not in known:
                raise DataError(f"{key} is {value!r}; it must be one of {', '.join(known)}")
        self.path = Path(path)
        self.task: Task = task
        self.cloth = cloth
        self.descriptor = descriptor
        self.keep_images = keep_images
        self._next = 0
        self._tick_s: float | None = None
        self._closed = False
        with writing(self.path):
            self._real = self.path.resolve()
            self._parts = parts_folder(self._real)
            check_place(self.path, self._real)
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
        name = schema.demo_name(self._next)
        image = file_image(name, episode, uuid.uuid4().hex, keep_images=self.keep_images)
        with writing(self.path):
            write_durably(self._parts / f"{name}.h5", image)
        self._next += 1
        self._tick_s = episode.tick_s
        # The episode is safe already; should there be no room to assemble, its part stays until there is.
        with contextlib.suppress(DataError, OSError):
            if self._worth_assembling():
                assemble(self.path)
        return KeptEpisode(name=name, path=self.path, ticks=len(episode.steps), size_bytes=len(image))

    def close(self) -> None:
        """Put everything into the one file. If that fails, the parts stay, and readers still find all episodes."""
        if self._closed:
            return
        self._closed = True
        try:
            if part_files(self._real):
                assemble(self.path)
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
        with writing(self.path):
            for stale in self._parts.glob(f"*{PART_SUFFIX}"):
                stale.unlink()
            fsync_path(self._real.parent)
        parts = part_files(self._real)
        if not parts and not self._real.exists():
            return
        with open_session(self.path) as session:
            for key in ("task", "cloth", "descriptor"):
                there, wanted = getattr(session, key), getattr(self, key)
                if there != wanted:
                    raise DataError(f"{self.path} holds episodes with {key} {there}, not {wanted}; choose another file")
            self._tick_s = session.tick_s
            self._next = 1 + max((schema.demo_number(name) for name in session.names), default=-1)
        if parts:
            assemble(self.path)

    def _check_fits(self, episode: Episode) -> None:
        for key, wanted, got in (
            ("task", self.task, episode.task),
            ("cloth", self.cloth, episode.cloth),
            ("descriptor", self.descriptor, episode.descriptor),
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


def assemble(path: Path) -> None:
    """Move all parts into the session's file; the caller holds the writer's lock."""
    with writing(path):
        real = path.resolve()
        aside = parts_folder(real) / f"session.h5{PART_SUFFIX}"
        with written_aside(real, aside), open_session(path) as session:
            _add_parts(session, real, aside)
            digests = {name: line.digest for name, line in session.lines().items()}
            added = {name: digests[name] for name in session.names if name not in session.main_names}
            check_copy(aside, added, session.names)
        for part in part_files(real):
            part.unlink()


def _add_parts(session: Session, real: Path, aside: Path) -> None:
    main, there = session.main_file, set(session.main_names)
    current = main is not None and main[schema.DATA].attrs[schema.VERSION] == schema.SCHEMA_VERSION
    if current:
        # A copy of the bytes, and then only what is new: what users have added stays as it is.
        shutil.copyfile(real, aside)
    with h5py.File(aside, "r+" if current else "x", libver=LIBVER) as file:
        lines = session.lines()
        target = SessionFile(file, {n: lines[n] for n in there} if current else None, indexed=session.indexed)
        for name in session.names:
            if name not in there or not current:
                target.copy(name, session.group(name), session.info(name))
        if main is not None and not current:
            target.copy_extras(main, {name: name for name in there})
        target.finish()


def check_place(path: Path, real: Path) -> None:
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


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Errors of the file system as one sentence."""
    try:
        yield
    except (OSError, RuntimeError) as error:  # RuntimeError: HDF5, closing a file that it could not write in full.
        raise DataError(
            f"{path} cannot be written: {os_reason(error)}; episodes that were kept before are safe"
        ) from error
