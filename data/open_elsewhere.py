"""Other programs that have a file open: a passing state, which ends when they close it."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path


def writers_of(path: Path) -> dict[int, str]:
    """Return name by number of the processes of this machine that have the file open for writing, as far as is seen.

    Where file locks are off, this is the only sign that a writer lives.
    """
    with contextlib.suppress(OSError):
        wanted = path.stat()
        found = {}
        for process in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                if _writes(process, wanted):
                    found[int(process.name)] = (process / "comm").read_text(errors="replace").strip()
        return found
    return {}


def _writes(process: Path, wanted: os.stat_result) -> bool:
    for descriptor in os.scandir(process / "fd"):
        with contextlib.suppress(OSError):  # It may be closed meanwhile.
            if os.path.samestat(descriptor.stat(), wanted):
                flags = next(line for line in (process / "fdinfo" / descriptor.name).open() if line.startswith("flags"))
                if int(flags.split()[1], 8) & os.O_ACCMODE != os.O_RDONLY:
                    return True
    return False
