"""Files that appear whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from layflat.data.atomic_files import atomic_path


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """A path beside ``path``, with its suffix, to write to; on success it takes the place of ``path``."""
    with atomic_path(path, path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")) as aside:
        yield aside


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text as a whole or not at all."""
    with atomic_write(path) as aside:
        aside.write_text(text, encoding="utf-8")
