"""`layflat data edit`: edits of a session's episodes, and their log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from layflat.app.support import validators
from layflat.app.support.console import print_table
from layflat.app.support.errors import say
from layflat.app.support.metrics import write_json
from layflat.data.format import schema
from layflat.data.session.edit_log import EditLog, read_log
from layflat.data.session.editor import SessionEditor
from layflat.data.session.reader import open_session


def relabel(path: Path, episode: str, outcome: str) -> None:
    """Label an episode."""
    name = episode_name(episode)
    with open_session(path) as session:
        before = session.info(name).outcome
    edit = SessionEditor(path).relabel(name, outcome)
    print(f"edit {edit.number}: {name} is {outcome}, was {before} {path}")


def trim(path: Path, episode: str, start: int, stop: int) -> None:
    """Cut an episode to some of its steps."""
    name = episode_name(episode)
    with open_session(path) as session:
        before = session.info(name).outcome
    edit = SessionEditor(path).trim(name, start, stop)
    with open_session(path) as session:
        after, of = session.info(name).outcome, session.catalog.entry(name).row.info.n_steps
    print(f"edit {edit.number}: {name} has {stop - start} of {of} steps, {after} {path}")
    if after != before:
        say(f"{name} was {before} and lost its end; `layflat data edit {path} relabel {name} {before}` labels it again")


def drop(path: Path, episodes: Sequence[str]) -> None:
    """Leave episodes out."""
    _each(path, "drop", episodes, "dropped")


def restore(path: Path, episodes: Sequence[str]) -> None:
    """Take dropped episodes in again."""
    _each(path, "restore", episodes, "restored")


def note(path: Path, episode: str, text: str) -> None:
    """Write a note on an episode."""
    name = episode_name(episode)
    with open_session(path) as session:
        session.info(name)
    edit = SessionEditor(path).note(name, text)
    print(f"edit {edit.number}: {name} has {'the note ' + repr(text) if text else 'no note'} {path}")


def undo(path: Path, number: int | None) -> None:
    """Take back an edit."""
    editor = SessionEditor(path)
    edit = editor.undo(number)
    print(f"edit {edit.number}: undid edit {edit.value}, {editor.log().edits[int(str(edit.value)) - 1].text} {path}")


def log(path: Path, *, json: Path | None, force: bool) -> None:
    """Print the edits of a session."""
    if json is not None:
        validators.writable_file(json, force=force, suffix=".json")
    with open_session(path, edits=False):
        found = read_log(path)
    if found.torn:
        say(found.torn)
    if json is not None:
        write_json(json, {"file": str(path), "edits": log_rows(found)})
    if not found.edits:
        print(f"no edits {path}")
        return
    rows = [
        [str(row["number"]), row["when_utc"][:19].replace("T", " "), row["who"], row["text"], "undone" * row["undone"]]
        for row in log_rows(found)
    ]
    print_table(("edit", "UTC", "who", "what", ""), rows, title=f"{path}", left=5)


def log_rows(found: EditLog) -> list[dict[str, Any]]:
    """Return the edits as JSON objects, oldest first."""
    undone = found.undone()
    return [{**asdict(edit), "text": edit.text, "undone": edit.number in undone} for edit in found.edits]


def episode_name(text: str) -> str:
    """Return demo_3 for "demo_3" and "3"."""
    return schema.demo_name(validators.episode_number(int(text))) if text.isascii() and text.isdigit() else text


def _each(path: Path, action: str, episodes: Sequence[str], done: str) -> None:
    editor = SessionEditor(path)
    for name in dict.fromkeys(map(episode_name, episodes)):
        edit = getattr(editor, action)(name)
        with open_session(path) as session:
            left = len(session)
        print(f"edit {edit.number}: {done} {name}, {left} episodes {path}")
