"""HDF5 files that are being written, also to a disk that is full.

When a write fails, HDF5 cannot close the file any more, and frees memory twice at the end of the process. So it never
sees one fail: from the first error on, what it writes is kept in memory, and the error is raised by `check`, at the
latest when the file is closed.
"""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py

from layflat.data.format.encode import LIBVER


class _DiskFile(io.RawIOBase):
    """File whose writes never fail; see above."""

    def __init__(self, path: Path, *, append: bool) -> None:
        self._file = path.open("r+b" if append else "x+b", buffering=0)
        self._at = 0
        self._error: OSError | None = None
        self._unwritten: list[tuple[int, bytes]] = []

    def check(self) -> None:
        """Raise the error of the first write that failed."""
        if self._error is not None:
            raise self._error

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._at = offset + (0, self._at, self._length())[whence]
        return self._at

    def tell(self) -> int:
        return self._at

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        here = self._at, self._at + len(buffer)
        content = bytearray(os.pread(self._file.fileno(), len(buffer), here[0]).ljust(len(buffer), b"\0"))
        for start, piece in self._unwritten:
            first, last = max(start, here[0]), min(start + len(piece), here[1])
            if first < last:
                content[first - here[0] : last - here[0]] = piece[first - start : last - start]
        buffer[:] = content
        self._at = here[1]
        return len(buffer)

    def write(self, data: memoryview) -> int:  # type: ignore[override]
        try:
            done = 0
            while self._error is None and done < len(data):
                done += os.pwrite(self._file.fileno(), data[done:], self._at + done)
        except OSError as error:
            self._error = error
        if self._error is not None:
            self._unwritten.append((self._at, bytes(data)))
        self._at += len(data)
        return len(data)

    def truncate(self, size: int | None = None) -> int:
        try:
            self._file.truncate(self._at if size is None else size)
        except OSError as error:
            self._error = self._error or error
        return self._length()

    def close(self) -> None:
        self._file.close()
        super().close()

    def _length(self) -> int:
        ends = (start + len(piece) for start, piece in self._unwritten)
        return max(os.fstat(self._file.fileno()).st_size, *ends, 0)


@contextlib.contextmanager
def written_file(path: Path, *, append: bool = False) -> Iterator[tuple[h5py.File, Callable[[], None]]]:
    """Yield a new HDF5 file, or one to ``append`` to, and a function that raises an OSError if the disk is full."""
    with contextlib.closing(_DiskFile(path, append=append)) as disk:
        with h5py.File(disk, "r+" if append else "w", libver=LIBVER) as file:
            yield file, disk.check
        disk.check()
