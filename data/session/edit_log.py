"""Edit log: relabel, trim, drop, restore, note and undo, in a file beside the session; the recording stays as it is.

``FILE.h5.edits.jsonl`` has a line of JSON for each edit, which is appended and flushed to the disk before the edit is
reported. It is a file of its own because a session is only ever written aside and renamed as a whole, which takes
seconds for a large one, and would make an edit wait for a recording that runs. The checksum of a line covers the line
and the checksum before it, so that a line that is damaged, missing or of another log is found.

An edit names its episode by uid and by content: it stays with the episode when that is renamed, merged, repaired or
copied, and a log that is copied along with its session works there.
"""

from __future__ import annotations

import getpass
import hashlib
import json
import os
import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Literal, TypeAlias, cast, get_args

from layflat.data.errors import DataError
from layflat.data.names import storable
from layflat.data.session.catalog import Catalog
from layflat.data.system_errors import os_reason
from layflat.data.types import OUTCOMES, Outcome

EditKind: TypeAlias = Literal["relabel", "trim", "drop", "restore", "note", "undo"]
EDIT_KINDS: tuple[EditKind, ...] = get_args(EditKind)
SUFFIX = ".edits.jsonl"
SCHEMA, VERSION = "layflat-edits", 1
HEADER: Mapping[str, Any] = {"schema": SCHEMA, "version": VERSION}
CHECK = "check"
"""Key of a line's checksum."""
NOTE_MAX = 2000
"""Longest note, characters."""
EditValue: TypeAlias = str | tuple[int, int] | int | None


class EditLogError(DataError):
    """An edit log that cannot be used."""


@dataclass(frozen=True, kw_only=True)
class Edit:
    """One line of the log."""

    number: int
    """Counts from 1; `undo` names an edit by it."""
    when_utc: str
    """Time of the machine's clock; for people only, the order is that of the lines."""
    who: str
    """user@host, or the name of a program."""
    kind: EditKind
    episode: str = ""
    """demo_<int>, the name of the episode at that time; empty for an undo."""
    uid: str = ""
    """Identity of the recording."""
    content: str = ""
    """Digest of the recorded content, see `layflat.data.format.content`."""
    value: EditValue = None
    """The outcome of a relabel, the (start, stop) of a trim, the text of a note, the number of the undone edit."""

    @property
    def text(self) -> str:
        """The edit in words: "relabel demo_3 failure", "trim demo_2 0 180", "undo 4"."""
        value = " ".join(map(str, self.value)) if isinstance(self.value, tuple) else self.value
        return " ".join(str(part) for part in (self.kind, self.episode, value) if part not in ("", None))


@dataclass(frozen=True, kw_only=True)
class EpisodeEdits:
    """The effect of all edits on one episode."""

    outcome: Outcome | None = None
    """Label of a person; None: as recorded."""
    bounds: tuple[int, int] | None = None
    """First recorded step to keep, and the one after the last; None: all."""
    dropped: Edit | None = None
    """Edit that dropped it; None: it is in the session."""
    note: str | None = None
    """None: as recorded."""

    def after(self, edit: Edit) -> EpisodeEdits:
        """Return the edits with one more."""
        if edit.kind == "relabel":
            return replace(self, outcome=cast(Outcome, edit.value))
        if edit.kind == "trim":
            return replace(self, bounds=cast("tuple[int, int]", edit.value))
        if edit.kind == "note":
            return replace(self, note=str(edit.value or ""))
        return replace(self, dropped=edit if edit.kind == "drop" else None)


UNEDITED = EpisodeEdits()


@dataclass(frozen=True, kw_only=True)
class EditLog:
    """The edits of a session, oldest first."""

    path: Path
    """File of the log; it does not exist before the first edit."""
    edits: tuple[Edit, ...] = ()
    torn: str = ""
    """Sentence on a last line that was cut off by a crash, which is ignored; else empty."""
    size: int = 0
    """Number of bytes without a torn line."""
    check: str = ""
    """Checksum of the last line."""

    def undone(self) -> frozenset[int]:
        """Return the numbers of the edits that do not count, because an undo that counts names them."""
        undone: set[int] = set()
        for edit in reversed(self.edits):
            if edit.kind == "undo" and edit.number not in undone:
                undone.add(cast(int, edit.value))
        return frozenset(undone)

    def active(self) -> tuple[Edit, ...]:
        """Return the edits that count, without undos."""
        undone = self.undone()
        return tuple(edit for edit in self.edits if edit.kind != "undo" and edit.number not in undone)

    def by_episode(self, catalog: Catalog) -> dict[str, EpisodeEdits]:
        """Return the edits of the episodes of a session that have any, by name.

        An episode is known by its uid, or where no episode has that uid, as after an import, by its content.
        """
        active = self.active()
        names = {row.info.uid: name for name, row in catalog.rows().items()} if active else {}
        by_content: dict[str, list[str]] = {}
        for name in names.values() if any(edit.uid not in names for edit in active) else ():
            by_content.setdefault(catalog.content(name), []).append(name)
        found: dict[str, EpisodeEdits] = {}
        for edit in active:
            for name in [names[edit.uid]] if edit.uid in names else by_content.get(edit.content, ()):
                found[name] = found.get(name, UNEDITED).after(edit)
        for name, edits in found.items():
            n_steps = catalog.entry(name).row.info.n_steps
            if edits.bounds is not None and edits.bounds[1] > n_steps:
                raise EditLogError(f"{self.path} keeps steps {edits.bounds} of {name}, which has {n_steps}; remove it")
            if edits.bounds == (0, n_steps):
                found[name] = replace(edits, bounds=None)
        return {name: edits for name, edits in found.items() if edits != UNEDITED}


def log_path(session: Path) -> Path:
    """Return the path of the edit log of the session at ``session``, links resolved."""
    real = session.resolve()
    return real.with_name(real.name + SUFFIX)


def read_log(session: Path) -> EditLog:
    """Return the edit log of a session, an empty one where there is none.

    Raises
    ------
    EditLogError
        If the file is no edit log, is damaged, or cannot be read. A last line without its end was never reported as
        done: it is left out, and `EditLog.torn` says so.
    """
    path = log_path(session)
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return EditLog(path=path)
    except OSError as error:
        raise EditLogError(f"{path} cannot be read: {os_reason(error)}") from error
    log, damage = _parsed(path, content)
    if damage is not None:
        raise damage
    return log


def intact_part(session: Path) -> tuple[bytes, EditLogError | None]:
    """Return the bytes of a session's edit log up to its first damaged line, and what is wrong with that."""
    path = log_path(session)
    if not path.exists():
        return b"", None
    content = path.read_bytes()
    log, error = _parsed(path, content)
    return content[: log.size], error


def _parsed(path: Path, content: bytes) -> tuple[EditLog, EditLogError | None]:
    *lines, rest = content.split(b"\n")
    torn = bool(rest)
    if not torn and lines and b"\0" in lines[-1]:
        # A power cut may leave a file longer, with zeros where the last line was to be.
        torn = bool(lines.pop())
    edits: list[Edit] = []
    size, check, error = 0, "", None
    try:
        if not lines:
            raise _foreign(path)
        check = _check_header(path, lines[0])
        size = len(lines[0]) + 1
        for number, line in enumerate(lines[1:], start=1):
            values, following = _checked_line(path, line, check, number + 1)
            edits.append(_edit_of(path, values, number))
            size, check = size + len(line) + 1, following
    except EditLogError as damage:
        error = damage
    return EditLog(path=path, edits=tuple(edits), torn=_torn_text(path) if torn else "", size=size, check=check), error


def header() -> tuple[bytes, str]:
    """Return the first line of a log and its checksum."""
    return _line(HEADER, "")


def line_of(edit: Edit, check: str) -> tuple[bytes, str]:
    """Return the line of an edit after the line with the checksum ``check``, and its own checksum."""
    return _line({key: value for key, value in asdict(edit).items() if value not in ("", None)}, check)


def new_edit(log: EditLog, kind: EditKind, *, who: str, **values: Any) -> Edit:
    """Return an edit that follows the last one of the log, of this moment."""
    now = datetime.now(timezone.utc).isoformat(timespec="seconds")
    return Edit(number=len(log.edits) + 1, when_utc=now, who=who, kind=kind, **values)


def this_person() -> str:
    """Return user@host of this program; the name in LAYFLAT_OPERATOR stands for the user."""
    from layflat.data.provenance import OPERATOR

    try:
        user = os.environ.get(OPERATOR) or getpass.getuser()
    except (KeyError, OSError):
        user = "unknown"
    return storable(f"{user}@{platform.node() or 'unknown'}")


def _torn_text(path: Path) -> str:
    return f"{path}: the last line is incomplete, as after a crash; that edit was not reported as done and is ignored"


def _foreign(path: Path) -> EditLogError:
    return EditLogError(
        f"{path} is not an edit log of layflat; move it away to read the session beside it as it was recorded"
    )


def _damaged(path: Path, line: int, reason: str) -> EditLogError:
    return EditLogError(
        f"{path} is damaged in line {line} ({reason}); use a copy, or `layflat data repair`, which keeps the edits"
        " before that line"
    )


def _check_header(path: Path, line: bytes) -> str:
    try:
        values = json.loads(line)
        version = values["version"] if values["schema"] == SCHEMA else None
    except (ValueError, TypeError, LookupError, RecursionError):
        raise _foreign(path) from None
    if version is None:
        raise _foreign(path)
    if version != VERSION:
        raise EditLogError(f"{path} is an edit log of version {version}; this layflat reads version {VERSION}")
    return _checked_line(path, line, "", 1)[1]


def _checked_line(path: Path, line: bytes, before: str, number: int) -> tuple[dict[str, Any], str]:
    try:
        values = json.loads(line)
        check = values.pop(CHECK)
    except (ValueError, TypeError, AttributeError, LookupError, RecursionError):
        raise _damaged(path, number, "it is no line of this file") from None
    if check != _digest(values, before):
        raise _damaged(path, number, "its checksum is wrong")
    return values, check


def _edit_of(path: Path, values: Mapping[str, Any], number: int) -> Edit:
    value = values.get("value")
    found = dict(values) | ({"value": tuple(value)} if isinstance(value, list) else {})
    names = {field.name for field in fields(Edit)}
    texts = all(isinstance(found.get(key, ""), str) for key in names - {"number", "value"})
    if not found.keys() <= names or not texts or found.get("number") != number or not _is_value(found, number):
        raise _damaged(path, number + 1, "it is no edit")
    return Edit(**found)


def _is_value(found: Mapping[str, Any], number: int) -> bool:
    kind, value = found.get("kind"), found.get("value")
    if kind == "relabel":
        return value in OUTCOMES
    if kind == "trim":
        return isinstance(value, tuple) and [type(step) for step in value] == [int, int] and 0 <= value[0] < value[1]
    if kind == "note":
        return isinstance(value, str | None)
    if kind == "undo":
        return type(value) is int and 0 < value < number
    return kind in EDIT_KINDS and value is None


def _line(values: Mapping[str, Any], before: str) -> tuple[bytes, str]:
    check = _digest(values, before)
    return json.dumps({**values, CHECK: check}, separators=(",", ":")).encode("ascii") + b"\n", check


def _digest(values: Mapping[str, Any], before: str) -> str:
    text = json.dumps(values, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(f"{before} {text}".encode("ascii")).hexdigest()[:16]
