"""episodes.csv: one row for each episode, durable the moment it is added, none twice.

A batch that was killed leaves at worst a torn last line, which is taken away when the file is opened again; its
episode is still there as a run.
"""

from __future__ import annotations

import contextlib
import csv
import io
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from layflat.app.support.errors import UsageError
from layflat.app.support.metrics import COLUMNS
from layflat.data.atomic_files import write_text

EXTRA = ("run", "start", "attempts", "reason")
"""The episode's name and file, how it began, how often it was tried, and why it crashed if it did."""
ALL_COLUMNS = (*COLUMNS, *EXTRA)
_RUN = ALL_COLUMNS.index("run")


class ResultsCsv:
    """The rows of a batch, on disk: in memory are only the names of their runs."""

    def __init__(self, path: Path) -> None:
        """Opens, and heals, what is there; UsageError where it is not a batch's."""
        self.path = path
        self.runs: set[str] = set()
        kept = _whole_lines(path)
        rows = [line for line in kept if line[_RUN] not in self.runs and not self.runs.add(line[_RUN])]  # type: ignore[func-returns-value]
        write_text(path, _text([list(ALL_COLUMNS), *rows]))

    def add(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """Returns when a power cut could no longer lose them; after an OSError, of a full disk, none is there."""
        new = [row for row in rows if row["run"] not in self.runs]
        text = _text([[_cell(row[name]) for name in ALL_COLUMNS] for row in new])
        descriptor = os.open(self.path, os.O_WRONLY | os.O_APPEND)
        try:
            _append(descriptor, text.encode("utf-8"))
        finally:
            os.close(descriptor)
        self.runs.update(row["run"] for row in new)

    def sort(self, key: Callable[[Mapping[str, str]], Any]) -> None:
        """Anew in an order that does not depend on which episode was finished first."""
        rows = [dict(zip(ALL_COLUMNS, line, strict=True)) for line in _whole_lines(self.path)]
        rows.sort(key=key)
        write_text(self.path, _text([list(ALL_COLUMNS), *([row[name] for name in ALL_COLUMNS] for row in rows)]))


def _append(descriptor: int, data: bytes) -> None:
    size = os.fstat(descriptor).st_size
    try:
        while data:
            data = data[os.write(descriptor, data) :]
        os.fsync(descriptor)
    except OSError:
        with contextlib.suppress(OSError):
            os.ftruncate(descriptor, size)
        raise


def _whole_lines(path: Path) -> list[list[str]]:
    """The rows without header, and without what a crash has torn; none where there is no file."""
    try:
        text = path.read_bytes().decode("utf-8", "replace")
    except FileNotFoundError:
        return []
    lines = list(csv.reader(io.StringIO(text[: text.rfind("\n") + 1])))
    if lines and tuple(lines[0]) != ALL_COLUMNS:
        raise UsageError(f"{path} is not a table of `layflat evaluate` of this version; choose another --out")
    return [line for line in lines[1:] if len(line) == len(ALL_COLUMNS) and line[_RUN]]


def _text(lines: Iterable[Iterable[str]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(lines)
    return text.getvalue()


def _cell(value: Any) -> str:
    """As pandas reads it back: floats to the last bit, nothing for None."""
    if value is None:
        return ""
    return repr(value) if isinstance(value, float) else " ".join(str(value).split())
