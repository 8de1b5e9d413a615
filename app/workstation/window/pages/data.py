"""DataPage: everything that `layflat data` does to a session, by the very same commands."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from layflat.app.workstation.subprocess_command import SubprocessCommand
from layflat.app.workstation.window.menu_style import Form
from layflat.app.workstation.window.pages.command import CommandPage
from layflat.data.format.schema import demo_number
from layflat.data.names import storable
from layflat.data.types import OUTCOMES

INTRO = (
    "Look at, check, change and convert sessions.",
    "Each operation is the command of the same name, which you can repeat in a terminal. No file is replaced unless "
    "you switch that on.",
)
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
PATHS = ("out",)


@dataclass
class DataPage(CommandPage):
    """Page of `layflat data`."""

    name: str = "Data"
    operation: str = "info"
    values: dict[str, str] = field(default_factory=dict)
    """Chosen and written values, by the field's name."""
    force: bool = False
    intro = INTRO
    _ended: SubprocessCommand | None = None
    """Last command whose end was noticed."""

    @property
    def fields(self) -> tuple[Field, ...]:
        """Options of the chosen operation."""
        return OPERATIONS[self.operation]

    def build(self) -> None:
        """Make the menu."""
        form = self.session_form("Data", "Session", self._files())
        if form is None:
            return
        form.choice("Operation", list(OPERATIONS), self.operation, self._choose_operation)
        for item in self.fields:
            self._add_field(form, item)
        if any(item.name in PATHS for item in self.fields):
            form.switch("Replace if it exists", self.force, self._set_force)
        form.button(self.operation.capitalize(), self.start, main=True)
        form.button("Cancel", self.cancel)

    def _files(self) -> list[str]:
        """Return the sessions; for an import, also files of other tools."""
        files = self.context.sessions()
        if self.operation != "import":
            return files
        return [
            *sorted(path.name for path in self.context.folder.glob("*.hdf5") if path.name == storable(path.name)),
            *files,
        ]

    def _add_field(self, form: Form, item: Field) -> None:
        value = self.values.setdefault(item.name, self._default(item))
        change = self._setter(item.name)
        choices: Mapping[str, Callable[[], list[str]]] = {
            "episode": self.episode_names, "outcome": lambda: [ANY, *OUTCOMES], "format": lambda: list(FORMATS),
            "session": lambda: [name for name in self.context.sessions() if name != self.session],
        }  # fmt: skip
        if item.kind in choices:
            names = choices[item.kind]()
            value = value if value in names else names[0] if names else ""
            self.values[item.name] = value
            form.choice(item.label, names, value, change)
        elif item.kind == "switch":
            form.switch(item.label, value == "on", lambda on: change("on" if on else "off"))
        else:
            form.entry(item.label, value, change)

    def _default(self, item: Field) -> str:
        return item.default.replace("{op}", self.operation).replace("{}", self.session.rsplit(".", 1)[0])

    def _setter(self, name: str) -> Callable[[str], None]:
        return lambda value: self.values.update({name: value})

    def choose_session(self, name: str) -> None:
        """Take another session."""
        if name != self.session:
            self.session, self.values, self.rebuild = name, {}, True

    def _choose_operation(self, name: str) -> None:
        if name != self.operation:
            self.operation, self.values, self.rebuild = name, {}, True

    def _set_force(self, on: bool) -> None:
        self.force = on

    def update(self) -> None:
        """Offer the files that a command has written."""
        if self.command is not None and not self.running and self.command is not self._ended:
            self._ended, self.rebuild = self.command, True
        super().update()

    def start(self) -> None:
        """Start the command."""
        self.run(self.arguments())

    def arguments(self) -> list[str]:
        """Return the command line of what was chosen."""
        folder = self.context.folder
        found = ["data", self.operation, str(folder / self.session)]
        for item in self.fields:
            value = self.values.get(item.name, self._default(item))
            if item.kind == "switch":
                found += [item.option] if value == "off" and self.values.get("format") == "lerobot" else []
            elif not value or value == ANY:
                continue
            elif item.kind == "session":
                found.append(str(folder / value))
            elif item.name == "share":
                found += [word for part in value.split() for word in (item.option, part)]
            elif item.kind == "episode":
                found += [item.option, str(demo_number(value))]
            else:
                found += [item.option, str(folder / value) if item.name in PATHS else value]
        return [*found, *(["--force"] if self.force and any(item.name in PATHS for item in self.fields) else [])]
