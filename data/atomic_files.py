"""Files that are complete or not there, even after a crash; and one writer at a time.

A file's name only ever points at finished bytes: they are written aside, flushed to the disk, and renamed, and the
folder is flushed too, without which a power cut could undo the renaming.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

from layflat.data.errors import DataError

PART_SUFFIX = ".part"
"""Suffix of a file that is being written; one that a killed writer left behind holds nothing that was saved."""
LOCK_NAME = "lock"
_ERRNO = re.compile(r"errno = (\d+)")


def os_reason(error: Exception) -> str:
    """Return the operating system's text for an error, also where HDF5 has wrapped it in its own."""
    number = getattr(error, "errno", None) or next((int(found) for found in _ERRNO.findall(str(error))), None)
    return os.strerror(number) if number else (str(error).splitlines() or ["unknown error"])[0]


def fsync_path(path: Path) -> None:
    """Flush a closed file or a folder to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextlib.contextmanager
def atomic_path(target: Path, aside: Path | None = None) -> Iterator[Path]:
    """Yield a path to write and close, which then durably becomes ``target``, or is removed after an error.

    By default it is a hidden file beside ``target`` with the same suffix.
    """
    aside = aside or target.with_name(f".{target.stem}.{os.getpid()}{PART_SUFFIX}{target.suffix}")
    aside.unlink(missing_ok=True)
    try:
        yield aside
        fsync_path(aside)
        os.replace(aside, target)
    except BaseException:
        with contextlib.suppress(OSError):
            aside.unlink(missing_ok=True)
        raise
    fsync_path(target.parent)


@contextlib.contextmanager
def atomic_folder(target: Path) -> Iterator[Path]:
    """Yield a new folder that then replaces the folder ``target``, or is removed after an error."""
    aside, old = (target.with_name(f".{target.name}.{os.getpid()}{suffix}") for suffix in (PART_SUFFIX, ".old"))
    shutil.rmtree(aside, ignore_errors=True)
    aside.mkdir(parents=True)
    try:
        yield aside
        # Out of the way first: a folder cannot replace a folder in one step.
        if target.exists():
            os.replace(target, old)
        os.replace(aside, target)
        shutil.rmtree(old, ignore_errors=True)
    finally:
        shutil.rmtree(aside, ignore_errors=True)


def write_bytes(target: Path, payload: bytes) -> None:
    """Write a file durably, completely or not at all."""
    with atomic_path(target) as aside:
        aside.write_bytes(payload)


def write_text(target: Path, text: str) -> None:
    """Write UTF-8 text durably, completely or not at all; lone surrogates are written out."""
    write_bytes(target, text.encode("utf-8", "backslashreplace"))


def fsync_write(target: Path, payload: bytes) -> None:
    """Write a new file and return when a power cut could no longer lose it; after any error there is none."""
    try:
        with atomic_path(target, target.with_name(target.name + PART_SUFFIX)) as aside:
            aside.write_bytes(payload)
    except BaseException:
        with contextlib.suppress(OSError):
            target.unlink(missing_ok=True)
        raise


_LOCKED: set[int] = set()
"""Descriptors of this process's locks."""


def lock_until_exit(descriptor: int) -> None:
    """Lock an open file until ``unlock`` or the end of this process; BlockingIOError where another one has locked it.

    Children that are forked meanwhile do not share the lock.
    """
    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    _LOCKED.add(descriptor)


def unlock(descriptor: int) -> None:
    """Close a file that lock_until_exit has locked; does nothing in a child that was forked since."""
    if descriptor in _LOCKED:
        _LOCKED.discard(descriptor)
        os.close(descriptor)


def _forget_locks_in_child() -> None:
    """Close the locks in a forked child, which would otherwise hold them when the writer itself is killed."""
    for descriptor in _LOCKED:
        os.close(descriptor)
    _LOCKED.clear()


os.register_at_fork(after_in_child=_forget_locks_in_child)


class WriterLock:
    """Lock of the one writer of a session; the system frees it when the process ends."""

    def __init__(self, folder: Path, subject: Path) -> None:
        """Lock ``folder``, which is created; DataError, naming ``subject``, where another writer holds it."""
        self._folder = folder
        self._path = folder / LOCK_NAME
        self._descriptor: int | None = None
        while self._descriptor is None:
            folder.mkdir(exist_ok=True)
            try:
                descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            except FileNotFoundError:
                continue  # The last writer removed the folder between the two lines.
            try:
                lock_until_exit(descriptor)
            except BlockingIOError:
                owner = os.pread(descriptor, 32, 0).decode("ascii", "replace").strip() or "unknown"
                os.close(descriptor)
                raise DataError(
                    f"{subject} is being written by another program (process {owner});"
                    " wait until it ends or choose another file"
                ) from None
            except BaseException:
                os.close(descriptor)
                raise
            if self._still_named(descriptor):
                self._descriptor = descriptor
            else:
                unlock(descriptor)
        with contextlib.suppress(OSError):  # A full disk has no room even for this, which only informs others.
            os.ftruncate(self._descriptor, 0)
            os.pwrite(self._descriptor, str(os.getpid()).encode("ascii"), 0)

    def release(self) -> None:
        """Give the lock back, and remove the folder if nothing else is in it."""
        if self._descriptor is None or self._descriptor not in _LOCKED:
            return
        # Removed while still locked: a process that opened it meanwhile finds the name gone and starts again.
        with contextlib.suppress(OSError):
            self._path.unlink()
        with contextlib.suppress(OSError):
            self._folder.rmdir()
        unlock(self._descriptor)
        self._descriptor = None

    def __enter__(self) -> WriterLock:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()

    def _still_named(self, descriptor: int) -> bool:
        try:
            return os.path.samestat(os.fstat(descriptor), os.stat(self._path))
        except FileNotFoundError:
            return False
