"""Files that are complete or not there, even after a crash; and one writer at a time.

A file's name only ever points at finished bytes: they are written aside, flushed to the disk, and renamed, and the
folder is flushed too, without which a power cut could undo the renaming.
"""

from __future__ import annotations

import contextlib
import fcntl
import itertools
import logging
import os
import platform
import shutil
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

from layflat.data.errors import DataError
from layflat.data.system_errors import NO_LOCKS, UNSUPPORTED, os_reason

PART_SUFFIX = ".part"
"""Suffix of a file that is being written; one that a killed writer left behind holds nothing that was saved."""
LOCK_NAME = "lock"
RENAMED_MAX = 100
"""Number of times that the lock's file may be another one than its name leads to."""
_LOG = logging.getLogger("layflat")


def flush(descriptor: int) -> None:
    """Flush an open file or folder to the disk, as far as its file system can."""
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in UNSUPPORTED:
            raise


def fsync_path(path: Path) -> None:
    """Flush a closed file to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        flush(descriptor)
    finally:
        os.close(descriptor)


def fsync_folder(folder: Path) -> None:
    """Flush the names in a folder to the disk; where that fails, warn at most, since the files are in place."""
    try:
        fsync_path(folder)
    except PermissionError:
        pass  # Of a folder that takes files but may not be listed.
    except OSError as error:
        _LOG.warning("layflat: %s may not survive a power cut yet: %s", folder, os_reason(error))


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
    except BaseException as error:
        if isinstance(error, OSError) and error.filename in (None, str(aside)):
            error.filename, error.filename2 = str(target), None
        with contextlib.suppress(OSError):
            aside.unlink(missing_ok=True)
        raise
    fsync_folder(target.parent)


@contextlib.contextmanager
def atomic_folder(target: Path) -> Iterator[Path]:
    """Yield a new folder that then replaces the folder ``target``, or is removed after an error."""
    aside, old = (target.with_name(f".{target.name}.{os.getpid()}{suffix}") for suffix in (PART_SUFFIX, ".old"))
    shutil.rmtree(aside, ignore_errors=True)
    aside.mkdir(parents=True)
    try:
        yield aside
        # Out of the way first: a folder cannot replace a folder in one step. Containers may only copy folders.
        if target.exists():
            shutil.move(target, old)
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


def lock_until_exit(descriptor: int, kind: int = fcntl.LOCK_EX) -> bool:
    """Lock an open file until ``unlock`` or the end of this process; BlockingIOError where another one has locked it.

    Children that are forked meanwhile do not share the lock. Returns False where the file system has no locks.
    """
    _LOCKED.add(descriptor)
    try:
        fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in NO_LOCKS:
            return False
        _LOCKED.discard(descriptor)
        raise
    return True


def unlock(descriptor: int) -> None:
    """Close a file that lock_until_exit has locked; does nothing in a child that was forked since."""
    if descriptor in _LOCKED:
        _LOCKED.discard(descriptor)
        os.close(descriptor)


def is_locked(path: Path) -> bool:
    """Return whether another program has the file locked as its writer, as HDF5 and the journals do."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        return False
    try:
        # Shared: network drives refuse to lock a file for a writer that is open for reading only.
        lock_until_exit(descriptor, fcntl.LOCK_SH)
    except BlockingIOError:
        os.close(descriptor)
        return True
    unlock(descriptor)
    return False


def _forget_locks_in_child() -> None:
    """Close the locks in a forked child, which would otherwise hold them when the writer itself is killed."""
    for descriptor in _LOCKED:
        os.close(descriptor)
    _LOCKED.clear()


os.register_at_fork(after_in_child=_forget_locks_in_child)


def _lives(process: str) -> bool:
    try:
        os.kill(int(process), 0)
    except PermissionError:
        return True
    except (OSError, ValueError):
        return False
    return True


class LockedError(DataError):
    """Another program is writing."""


class WriterLock:
    """Lock of the one writer of a session; the system frees it when the process ends."""

    def __init__(self, folder: Path, subject: Path, name: str = LOCK_NAME) -> None:
        """Lock ``folder``, which is created; LockedError, naming ``subject``, where another writer holds it.

        Locks of different names are independent of one another.
        """
        self._folder = folder
        self._path = folder / name
        self._descriptor: int | None = None
        for attempt in itertools.count():
            try:
                folder.mkdir(exist_ok=True)
                descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            except (FileNotFoundError, FileExistsError):
                # The last writer removed the folder between two looks at it.
                if attempt > RENAMED_MAX:
                    raise
                continue
            self._lock(descriptor, subject)
            # Some network drives number their files differently each time.
            if self._still_named(descriptor) or attempt > RENAMED_MAX:
                self._descriptor = descriptor
                break
            unlock(descriptor)
        with contextlib.suppress(OSError):  # A full disk has no room even for this, which only informs others.
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, f"{os.getpid()} {platform.node()}".encode(), 0)

    def _lock(self, descriptor: int, subject: Path) -> None:
        """Lock the file; where its file system has no locks, believe the process that it names."""
        advice = "wait until it ends, or choose another name"
        try:
            locked = lock_until_exit(descriptor)
            owner, _, host = os.pread(descriptor, 300, 0).decode("utf-8", "replace").strip().partition(" ")
            if locked or not owner or (host == platform.node() and not _lives(owner)):
                return
            advice += f", or delete {self._path} if it has ended"
            unlock(descriptor)
        except BlockingIOError:
            owner = os.pread(descriptor, 300, 0).decode("utf-8", "replace").partition(" ")[0] or "unknown"
            os.close(descriptor)
        except BaseException:
            os.close(descriptor)
            raise
        raise LockedError(f"{subject} is being written by another program (process {owner}); {advice}")

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
