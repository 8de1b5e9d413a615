"""SessionEditor: edits episodes of a session by its edit log, and takes edits back."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from layflat.data.atomic_files import LockedError, WriterLock, flush, fsync_write
from layflat.data.errors import DataError
from layflat.data.names import storable
from layflat.data.session.catalog import Catalog
from layflat.data.session.edit_log import (
    NOTE_MAX,
    Edit,
    EditKind,
    EditLog,
    header,
    line_of,
    log_path,
    new_edit,
    read_log,
    this_person,
)
from layflat.data.session.parts import part_files, parts_folder
from layflat.data.session.session_writer import write_errors
from layflat.data.types import OUTCOMES

LOCK_NAME = "edits.lock"
"""Lock of the log, in the session's folder of parts: a recording, which holds the session's own, may run meanwhile."""
WAIT_S = 2.0
"""Longest wait for another program's edit, which takes some milliseconds."""


class SessionEditor:
    """Edits of one session; each method returns when the edit is durable. Usable from any thread and any process.

    The recording itself is never written. Sessions that are opened afterwards have the edit applied.

    >>> editor = SessionEditor("demos.h5")
    >>> editor.relabel("demo_3", "failure")
    >>> editor.undo()

    Parameters
    ----------
    path : str or Path
        The session's file.
    who : str, optional
        Author of the edits; user@host by default.

    Raises
    ------
    DataError
        By each method, where the episode or value is wrong, or the log cannot be used or written; nothing has changed
        then.
    """

    def __init__(self, path: str | Path, *, who: str | None = None) -> None:
        self.path = Path(path)
        self.who = this_person() if who is None else storable(who)

    def relabel(self, episode: str, outcome: str) -> Edit:
        """Label an episode success, failure or partial."""
        if outcome not in OUTCOMES:
            raise DataError(f"outcome is {outcome!r}; it must be one of {', '.join(OUTCOMES)}")
        return self._edit("relabel", episode, outcome)

    def trim(self, episode: str, start: int, stop: int) -> Edit:
        """Keep the steps ``start`` to ``stop - 1``, counted as recorded, so that a later trim may keep more again.

        An episode that loses its end becomes ``partial``, unless the cloth lies as it did at the recorded end, or a
        person has labelled it.
        """
        return self._edit("trim", episode, (start, stop))

    def drop(self, episode: str) -> Edit:
        """Leave an episode out of the session; its name stays reserved."""
        return self._edit("drop", episode)

    def restore(self, episode: str) -> Edit:
        """Take a dropped episode in again, with its other edits."""
        return self._edit("restore", episode)

    def note(self, episode: str, text: str) -> Edit:
        """Replace the note of an episode; an empty text removes it."""
        if len(text) > NOTE_MAX:
            raise DataError(f"the note has {len(text)} characters; it must have at most {NOTE_MAX}")
        return self._edit("note", episode, storable(text.replace("\0", "")))

    def undo(self, number: int | None = None) -> Edit:
        """Take back an edit, by default the newest that counts; naming an undo takes back the undo.

        Edits of the same episode do not depend on each other, so that each can be taken back alone.
        """
        with self._locked() as log:
            counting = log.active()
            if number is None:
                if not counting:
                    raise DataError(f"{self.path} has no edit to undo")
                number = counting[-1].number
            if not 0 < number <= len(log.edits):
                raise DataError(f"{self.path} has no edit {number}; it has {len(log.edits)}")
            if number in log.undone():
                raise DataError(f"edit {number} of {self.path} has been undone already ({log.edits[number - 1].text})")
            return self._append(log, "undo", value=number)

    def log(self) -> EditLog:
        """Return all edits so far."""
        return read_log(self.path)

    def _edit(self, kind: EditKind, episode: str, value: Any = None) -> Edit:
        with self._locked() as log, closing(Catalog(self.path)) as catalog:
            info = catalog.entry(episode).row.info
            if kind == "trim" and not 0 <= value[0] < value[1] <= info.n_steps:
                raise DataError(
                    f"steps {value[0]} to {value[1]} of {episode} cannot be kept; it has the steps 0 to {info.n_steps}"
                )
            if kind in ("drop", "restore"):
                now = log.by_episode(catalog).get(episode)
                if (now is not None and now.dropped is not None) == (kind == "drop"):
                    state = "is dropped already" if kind == "drop" else "was not dropped"
                    raise DataError(f"{episode} of {self.path} {state}; nothing to {kind}")
            return self._append(log, kind, episode=episode, uid=info.uid, content=catalog.content(episode), value=value)

    def _append(self, log: EditLog, kind: EditKind, **values: Any) -> Edit:
        edit = new_edit(log, kind, who=self.who, **values)
        with write_errors(log.path):
            if not log.check:
                first, check = header()
                fsync_write(log.path, first + line_of(edit, check)[0])
                return edit
            descriptor = os.open(log.path, os.O_WRONLY | os.O_CLOEXEC)
            try:
                os.ftruncate(descriptor, log.size)  # Without a torn line.
                line, done = line_of(edit, log.check)[0], 0
                try:
                    while done < len(line):
                        done += os.pwrite(descriptor, line[done:], log.size + done)
                    flush(descriptor)
                except OSError:
                    os.ftruncate(descriptor, log.size)
                    raise
            finally:
                os.close(descriptor)
        return edit

    @contextmanager
    def _locked(self) -> Iterator[EditLog]:
        path, real = log_path(self.path), self.path.resolve()
        if not real.is_file() and not part_files(real):
            raise DataError(f"{self.path} does not exist; record a session first or correct the path")
        give_up = time.monotonic() + WAIT_S
        with write_errors(path):
            while True:
                try:
                    lock = WriterLock(parts_folder(real), path, LOCK_NAME)
                    break
                except LockedError:
                    if time.monotonic() > give_up:
                        raise
                    time.sleep(0.005)
        with lock:
            yield read_log(self.path)
