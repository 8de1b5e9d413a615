"""Operations: every command of `layflat data` that works on one session, and its options, as a form needs them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from layflat.app.support.errors import UsageError
from layflat.app.workstation.web.folder import Folder
from layflat.data.format.schema import demo_number

ANY = "any"


class Field(NamedTuple):
    """One option of a command."""

    name: str
    label: str
    option: str
    """``--out`` and the like; empty for a second session (merge)."""
    kind: str
    """text, episode, outcome, format, session or switch."""
    default: str = ""
    """``{}`` stands for the name of the session, ``{op}`` for that of the operation."""


_OUT = Field("out", "Session to write", "--out", "text", "{}-{op}.h5")
_EPISODE = Field("episode", "Episode", "--episode", "episode")
_OUTCOME = Field("outcome", "Outcome", "--outcome", "outcome")
OPERATIONS: Mapping[str, tuple[Field, ...]] = {
    "info": (),
    "validate": (),
    "stats": (),
    "split": (
        Field("out", "Folder for the parts", "--out", "text", "{}-parts"),
        Field("share", "Parts and their shares", "--share", "text", "train=0.8 valid=0.2"),
        Field("seed", "Seed", "--seed", "text", "0"),
    ),
    "filter": (
        _OUT,
        _OUTCOME,
        Field("source", "Source", "--source", "text"),
        Field("cloth", "Cloth", "--cloth", "text"),
        Field("min-contact", "Final contact, at least", "--min-contact", "text"),
        Field("max-contact", "Final contact, at most", "--max-contact", "text"),
        Field("min-steps", "Steps, at least", "--min-steps", "text"),
        Field("max-steps", "Steps, at most", "--max-steps", "text"),
    ),
    "merge": (Field("with", "With", "", "session"), _OUT),
    "trim": (
        _EPISODE, _OUT,
        Field("start", "First step to keep", "--start", "text", "0"),
        Field("stop", "Step after the last one (empty: the end)", "--stop", "text"),
    ),
    "repair": (Field("out", "Write to (empty: in place)", "--out", "text"),),
    "export": (
        Field("format", "Format", "--format", "format"), Field("out", "File or folder", "--out", "text", "{}-export"),
        _OUTCOME, Field("images", "With images (lerobot)", "--no-images", "switch", "on"),
    ),
    "import": (Field("out", "Session to write", "--out", "text", "{}-imported.h5"),
               Field("cloth", "Cloth (if the file has none)", "--cloth", "text")),
    "video": (_EPISODE, Field("out", "Video to write", "--out", "text", "{}.webm")),
    "plot": (Field("out", "Picture to write", "--out", "text", "{}.png"),),
}  # fmt: skip
"""Every command of `layflat data`, and its options; a test compares them with the command line."""
FORMATS = ("robomimic", "lerobot", "csv")

WRITES = "out"
"""Field that names what is written."""


def arguments_of(operation: str, folder: Folder, session: str, values: Mapping[str, str], *, force: bool) -> list[str]:
    """Return the command line of an operation with the values of its fields, each of which stays in the folder."""
    found = ["data", operation, str(folder.path / session)]
    for item in OPERATIONS[operation]:
        value = values.get(item.name, "").strip()
        if item.kind == "switch":
            found += [item.option] if value == "off" and values.get("format") == "lerobot" else []
        elif not value or value == ANY:
            continue
        elif value.startswith("-"):
            raise UsageError(f"{item.label} is {value!r}; give a value without a leading -")
        elif item.kind == "session":
            found.append(str(folder.session(value)))
        elif item.name == "share":
            found += [word for part in value.split() for word in (item.option, part)]
        elif item.kind == "episode":
            found += [item.option, str(demo_number(value))]
        else:
            found += [item.option, str(folder.new(value)) if item.name == WRITES else value]
    writes = any(item.name == WRITES for item in OPERATIONS[operation])
    return [*found, *(["--force"] if force and writes else [])]
