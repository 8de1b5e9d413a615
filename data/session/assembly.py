"""Moves finished episodes from a session's folder of parts into its file."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path

import h5py

from layflat.data.atomic_files import PART_SUFFIX, atomic_path
from layflat.data.format.encode import LIBVER
from layflat.data.session.parts import part_files, parts_folder
from layflat.data.session.reader import Session, open_session
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
        with atomic_path(real, aside), open_session(path) as session:
            _write_all(session, real, aside)
            digests = {name: row.digest for name, row in session.index_rows().items()}
            added = {name: digest for name, digest in digests.items() if name not in session.main_names}
            check_copy(aside, added, session.names)
        for part in parts:
            part.unlink()


def _check_room(real: Path) -> None:
    """Raise an OSError where the disk is too full: HDF5 may abort the process when copying fails half-way."""
    needed = sum(file.stat().st_size for file in (real, *part_files(real)) if file.exists()) + MARGIN_BYTES
    if shutil.disk_usage(real.parent).free < needed:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _write_all(session: Session, real: Path, aside: Path) -> None:
    if session.main_file is not None:
        # A copy of the bytes, to which only new demos are added: what users have added stays as it is.
        shutil.copyfile(real, aside)
    with h5py.File(aside, "x" if session.main_file is None else "r+", libver=LIBVER) as file:
        rows = session.index_rows()
        target = SessionFile(file, {name: rows[name] for name in session.main_names}, indexed=session.indexed)
        for name in session.names:
            if name not in session.main_names:
                target.copy(name, session.group(name), session.info(name))
        target.finish()
