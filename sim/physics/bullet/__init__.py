"""The PyBullet engine; no other folder imports PyBullet.

Its first import prints the time of its build from C code, which Python's own streams cannot stop: file descriptors 1
and 2 lead nowhere meanwhile.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys


def _import_silently() -> None:
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
        import pybullet  # noqa: F401
    finally:
        # C's stdout is buffered when it is a pipe: discard what it holds, too.
        ctypes.CDLL(None).fflush(None)
        for number, copy in saved:
            os.dup2(copy, number)
            os.close(copy)


if "pybullet" not in sys.modules:
    _import_silently()
