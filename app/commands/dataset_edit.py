"""`layflat data edit`: edits of a session's episodes, and their log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from layflat.app.support import validators
from layflat.app.support.console import print_table
from layflat.app.support.errors import UsageError, say
from layflat.app.support.metrics import write_json
from layflat.data.format import schema
from layflat.data.session.edit_log import EditLog, read_log
from layflat.data.session.editor import SessionEditor
from layflat.data.session.reader import open_session

FORMS = {
    "relabel": ("demo_K success|failure|partial", 2, 2),
    "trim": ("demo_K FROM TO", 3, 3),
    "drop": ("demo_K...", 1, None),
    "restore": ("demo_K...", 1, None),
    "note": ("demo_K TEXT", 2, None),
    "undo": ("[N]", 0, 1),
    "log": ("no values", 0, 0),
}
"""Values of each action, and how many there are at least and at most."""


def edit(path: Path, action: str, values: Sequence[str], *, json: Path | None, force: bool) -> None:
    """Edit a session, or print its edits; ``json`` gets all edits afterwards."""
    form, least, most = FORMS[action]
    if len(values) < least or (most is not None and len(values) > most):
        raise UsageError(f"{action} takes {form}, got {' '.join(map(repr, values)) or 'none'}")
    if json is not None:
        validators.writable_file(json, force=force, suffix=".json")
    if action in ("drop", "restore"):
        _take(path, action, values)
    elif action == "undo":
        _undo(path, _integer("the number of an edit", values[0]) if values else None)
    elif action != "log":
        _change(path, action, episode_name(values[0]), values[1:])
    found = read_log(path)
    if json is not None:
        write_json(json, {"file": str(path), "edits": log_rows(found)})
    if action == "log":
        _print_log(path, found)


def _change(path: Path, action: str, name: str, values: Sequence[str]) -> None:
    """Relabel, trim or annotate an episode."""
    with open_session(path) as session:
        before = session.info(name).outcome
    editor = SessionEditor(path)
    if action == "relabel":
        done = editor.relabel(name, values[0])
    elif action == "trim":
        done = editor.trim(name, *(_integer("a step", value) for value in values))
    else:
        done = editor.note(name, " ".join(values))
    with open_session(path) as session:
        info, recorded = session.info(name), session.catalog.entry(name).row.info
    text = {
        "relabel": f"is {info.outcome}, was {before}",
        "trim": f"has {info.n_steps} of {recorded.n_steps} steps, {info.outcome}",
        "note": f"has the note {info.note!r}" if info.note else "has no note",
    }
    print(f"edit {done.number}: {name} {text[action]} {path}")
    if action == "trim" and info.outcome != before:
        say(f"{name} was {before} and lost its end; `layflat data edit {path} relabel {name} {before}` labels it again")


def _take(path: Path, action: str, episodes: Sequence[str]) -> None:
    """Drop or restore episodes."""
    editor = SessionEditor(path)
    for name in dict.fromkeys(map(episode_name, episodes)):
        done = editor.drop(name) if action == "drop" else editor.restore(name)
        with open_session(path) as session:
            print(f"edit {done.number}: {action} {name}, {len(session)} episodes {path}")


def _undo(path: Path, number: int | None) -> None:
    """Take back an edit."""
    editor = SessionEditor(path)
    done = editor.undo(number)
    undone = next(edit for edit in editor.log().edits if edit.number == done.value)
    print(f"edit {done.number}: undid edit {undone.number}, {undone.text} {path}")


def _print_log(path: Path, found: EditLog) -> None:
    """Print a table of the edits."""
    with open_session(path, edits=False):
        pass
    if found.torn:
        say(found.torn)
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


def _integer(what: str, text: str) -> int:
    """Return a whole number of at least 0; UsageError otherwise."""
    if not text.isascii() or not text.isdigit():
        raise UsageError(f"{what} must be an integer >= 0, got {text}")
    return int(text)
