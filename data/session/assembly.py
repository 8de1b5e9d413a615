"""Moves finished episodes from a session's folder of parts into its file."""

from __future__ import annotations

import errno
import os
import shutil
from contextlib import closing
from pathlib import Path

from layflat.data.atomic_files import PART_SUFFIX, atomic_path
from layflat.data.format.h5_writing import written_file
from layflat.data.session.catalog import Catalog
from layflat.data.session.parts import part_files, parts_folder
from layflat.data.session.session_writer import SessionFile, check_copy, write_errors

PARTS_MAX = 200
"""Largest number of parts: each costs a reader an open file, of which a process may have 256 on some systems."""

MARGIN_BYTES = 1 << 16
"""Room for the structures of HDF5 and a running journal, on top of the data."""


def is_worthwhile(real: Path) -> bool:
    """Return whether the parts weigh as much as the file, so that all copying together stays in proportion."""
    parts = part_files(real)
    assembled = real.stat().st_size if real.exists() else 0
    return len(parts) >= PARTS_MAX or sum(part.stat().st_size for part in parts) >= assembled


def assemble(path: Path) -> None:
    """Move all parts into the session's file; the caller holds the writer's lock."""
    with write_errors(path):
        real = path.resolve()
        # Listed before they are read: a part that another process finishes meanwhile stays for the next time.
        parts = part_files(real)
        aside = parts_folder(real) / f"session.h5{PART_SUFFIX}"
        _check_room(real)
        with atomic_path(real, aside), closing(Catalog(path)) as catalog:
            rows = catalog.rows()
            _write_all(catalog, real, aside)
            added = {name: row.digest for name, row in rows.items() if name not in catalog.main_names}
            check_copy(aside, added, rows)
        for part in parts:
            part.unlink()


def _check_room(real: Path) -> None:
    """Raise an OSError where the disk is too full, before all is copied in vain."""
    needed = sum(file.stat().st_size for file in (real, *part_files(real)) if file.exists()) + MARGIN_BYTES
    if shutil.disk_usage(real.parent).free < needed:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _write_all(catalog: Catalog, real: Path, aside: Path) -> None:
    rows, there = catalog.rows(), catalog.main_names
    if catalog.main is not None:
        # A copy of the bytes, to which only new demos are added: what users have added stays as it is.
        shutil.copyfile(real, aside)
    with written_file(aside, append=catalog.main is not None) as (file, check):
        target = SessionFile(file, {name: rows[name] for name in there}, indexed=catalog.indexed, check=check)
        for name in (name for name in rows if name not in there):
            target.copy(name, catalog.group(name), rows[name].info)
        target.finish()
