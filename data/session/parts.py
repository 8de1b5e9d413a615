"""Files in ``FILE.h5.parts``: finished episodes that are not yet in the session, and journals of running ones."""

from __future__ import annotations

from pathlib import Path

from layflat.data.atomic_files import is_locked
from layflat.data.format import schema

JOURNAL_GLOB = "running-*.journal"


def parts_folder(path: Path) -> Path:
    """Return the folder of the episodes of the session at ``path`` that have not been moved into it yet."""
    return path.with_name(path.name + ".parts")


def part_files(path: Path) -> list[Path]:
    """Return the finished single-episode files of the session at ``path`` by number."""
    folder = parts_folder(path)
    if not folder.is_dir():
        return []
    files = [file for file in folder.glob("demo_*.h5") if schema.DEMO_NAME.fullmatch(file.stem)]
    return sorted(files, key=lambda file: schema.demo_number(file.stem))


def journals(folder: Path) -> list[Path]:
    """Return the journals in a folder of parts, whether their writers live or not."""
    return sorted(folder.glob(JOURNAL_GLOB)) if folder.is_dir() else []


def journal_path(folder: Path, uid: str) -> Path:
    """Return the path of an episode's journal in a folder of parts."""
    return folder / JOURNAL_GLOB.replace("*", uid)


def is_orphaned(journal: Path) -> bool:
    """Return whether the journal is there and no process writes to it any more."""
    return not is_locked(journal) and journal.exists()
