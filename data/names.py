"""Names that are not UTF-8: their bytes are lone surrogates in Python's text, which few libraries can take."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def storable(text: str) -> str:
    r"""Return ``text`` with lone surrogates written out, such as ``\udcf6``."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


@contextmanager
def ascii_folder(path: Path) -> Iterator[str]:
    """Yield a path with an ASCII folder, for libraries in C that cannot take every name; the file's own must be ASCII.

    OpenCV crashes on a path that is not UTF-8, and PyBullet refuses it.
    """
    if not path.name.isascii():
        raise ValueError(f"{path.name!a} is not ASCII")
    if str(path).isascii() or not os.path.isdir("/proc/self/fd"):
        yield str(path)
        return
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        yield f"/proc/self/fd/{folder}/{path.name}"
    finally:
        os.close(folder)
