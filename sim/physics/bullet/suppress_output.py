"""The first import of PyBullet, without the build time that it prints; the package imports this before all others."""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
from collections.abc import Iterator


@contextlib.contextmanager
def suppress_output() -> Iterator[None]:
    """Discard what C code writes to file descriptors 1 and 2, which Python's own streams cannot stop."""
    libc = ctypes.CDLL(None)
    saved: list[tuple[int, int]] = []
    try:
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()
        with open(os.devnull, "wb") as null:
            for number in (1, 2):
                with contextlib.suppress(OSError):  # The parent may have closed it.
                    saved.append((number, os.dup(number)))
                    os.dup2(null.fileno(), number)
        yield
    finally:
        # C's stdout is buffered when it is a pipe: discard what it holds, too.
        libc.fflush(None)
        for number, copy in saved:
            os.dup2(copy, number)
            os.close(copy)


if "pybullet" not in sys.modules:
    with suppress_output():
        import pybullet  # noqa: F401  # for its side effect: the line is printed once in a process
