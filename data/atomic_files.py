"""Files that are whole or not there, whatever happens while they are written; and one writer at a time.

A finished file's name only ever points at finished bytes: they are written aside, flushed to the disk, and renamed, and
the folder is flushed too, without which a power cut could undo the renaming.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

from layflat.data.errors import DataError

PART_SUFFIX = ".part"
"""Of a file that is being written; what a killed writer left behind under such a name holds nothing that was kept."""
LOCK_NAME = "lock"
_ERRNO = re.compile(r"errno = (\d+)")


def os_reason(error: Exception) -> str:
    """The operating system's words for an error, also where HDF5 has wrapped it in its own."""
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
def atomic_path(target: Path, aside: Path) -> Iterator[Path]:
    """Yields ``aside`` to be written and closed; then makes it ``target`` durably, or on any failure removes it."""
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


def fsync_write(target: Path, payload: bytes) -> None:
    """A new file; returns when a power cut could no longer lose it. On any failure there is none."""
    try:
        with atomic_path(target, target.with_name(target.name + PART_SUFFIX)) as aside:
            aside.write_bytes(payload)
    except BaseException:
        with contextlib.suppress(OSError):
            target.unlink(missing_ok=True)
        raise


_HELD: set[int] = set()
"""Descriptors of this process's locks."""


def lock_until_exit(descriptor: int) -> None:
    """Lock an open file until ``unlock``, or until this process ends, however it ends; BlockingIOError where another
    process has it locked. Children that are forked meanwhile do not share the lock."""
    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    _HELD.add(descriptor)


def unlock(descriptor: int) -> None:
    """Close what lock_until_exit has locked; nothing in a child that was forked since."""
    if descriptor in _HELD:
        _HELD.discard(descriptor)
        os.close(descriptor)


def _leave_to_parent() -> None:
    """A forked child shares the lock's open file, and would keep it locked when the writer itself is killed."""
    for descriptor in _HELD:
        os.close(descriptor)
    _HELD.clear()


os.register_at_fork(after_in_child=_leave_to_parent)


class WriterLock:
    """Held by the one writer of a session; the system frees it when the process ends, however it ends."""

    def __init__(self, folder: Path, subject: Path) -> None:
        """Makes ``folder`` where need be; DataError, naming ``subject``, where another writer holds it."""
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
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
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
                _HELD.add(descriptor)
            else:
                os.close(descriptor)
        with contextlib.suppress(OSError):  # A full disk has no room even for this, which is only said to others.
            os.ftruncate(self._descriptor, 0)
            os.pwrite(self._descriptor, str(os.getpid()).encode("ascii"), 0)

    def release(self) -> None:
        """Give the lock back, and remove the folder if nothing else is in it."""
        if self._descriptor is None or self._descriptor not in _HELD:
            return
        # Removed while still held: whoever opened it meanwhile sees that the name is gone and starts again.
        with contextlib.suppress(OSError):
            self._path.unlink()
        with contextlib.suppress(OSError):
            self._folder.rmdir()
        _HELD.discard(self._descriptor)
        os.close(self._descriptor)
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
