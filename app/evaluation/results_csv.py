"""ResultsCsv: episodes.csv, one row for each episode, durable the moment it is added, none twice.

An evaluation that was killed leaves at worst a torn last line, which is removed when the file is opened again; the
episode of that line is still there as a run.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from layflat.app.support.errors import UsageError
from layflat.app.support.metrics import COLUMNS
from layflat.data.atomic_files import flush, write_text
from layflat.data.columns import write_legend

EXTRA = ("run", "start", "attempts", "reason")
"""The episode's name, its start, how often it was tried, and why it crashed if it did."""
ALL_COLUMNS = (*COLUMNS, *EXTRA)
_RUN = ALL_COLUMNS.index("run")


class ResultsCsv:
    """The rows of an evaluation on disk; in memory are only the names of their runs."""

    def __init__(self, path: Path) -> None:
        """Open and heal the file; UsageError where it is not one of an evaluation."""
        self.path = path
        rows = {line[_RUN]: line for line in reversed(_whole_lines(path))}
        self.runs = set(rows)
        write_text(path, _text([ALL_COLUMNS, *reversed(rows.values())]))
        write_legend(path.parent, {path.name: ALL_COLUMNS})

    def add(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """Add rows, durable on return; after an OSError, of a full disk, none of them is there."""
        new = [row for row in rows if row["run"] not in self.runs]
        text = _text([[_cell(row[name]) for name in ALL_COLUMNS] for row in new])
        descriptor = os.open(self.path, os.O_WRONLY | os.O_APPEND)
        try:
            _append(descriptor, text.encode("utf-8", "backslashreplace"))
        finally:
            os.close(descriptor)
        self.runs.update(row["run"] for row in new)

    def sort(self, key: Callable[[Mapping[str, str]], Any]) -> None:
        """Sort the rows by ``key``, so that their order does not depend on which episode was finished first."""
        lines = _whole_lines(self.path)
        lines.sort(key=lambda line: key(dict(zip(ALL_COLUMNS, line, strict=True))))
        write_text(self.path, _text([ALL_COLUMNS, *lines]))


def _append(descriptor: int, data: bytes) -> None:
    size = os.fstat(descriptor).st_size
    try:
        while data:
            data = data[os.write(descriptor, data) :]
        flush(descriptor)
    except OSError:
        with contextlib.suppress(OSError):
            os.ftruncate(descriptor, size)
        raise


def _whole_lines(path: Path) -> list[list[str]]:
    """Return the rows without the header and without what a crash has torn; none where there is no file."""
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
    """Return the text that pandas reads back: floats to the last bit, nothing for None."""
    if value is None:
        return ""
    if isinstance(value, Mapping):
        return json.dumps(value)
    return repr(value) if isinstance(value, float) else " ".join(str(value).split())
