"""The first import of PyBullet, which prints its build time, silenced; the package imports it before all others."""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
from collections.abc import Iterator


@contextlib.contextmanager
def suppress_output() -> Iterator[None]:
    """Send what C code writes to file descriptors 1 and 2 to nowhere; Python's own streams cannot stop it."""
    libc = ctypes.CDLL(None)
    kept: list[tuple[int, int]] = []
    try:
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()
        with open(os.devnull, "wb") as nowhere:
            for number in (1, 2):
                with contextlib.suppress(OSError):  # closed by whoever started us
                    kept.append((number, os.dup(number)))
                    os.dup2(nowhere.fileno(), number)
        yield
    finally:
        # C's stdout is buffered when it is a pipe: what it holds must go to nowhere too.
        libc.fflush(None)
        for number, copy in kept:
            os.dup2(copy, number)
            os.close(copy)


if "pybullet" not in sys.modules:
    with suppress_output():
        import pybullet  # noqa: F401  # for its side effect: the line is printed once in a process
