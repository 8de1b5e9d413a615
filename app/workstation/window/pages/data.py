"""Data: everything that `layflat data` does to a session, by the very same commands."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import pygame_menu

from layflat.app.workstation.window import menu_style
from layflat.app.workstation.window.pages.command import CommandPage
from layflat.app.workstation.window.subprocess_command import SubprocessCommand
from layflat.data.format.schema import demo_number
from layflat.data.session.reader import open_session
from layflat.data.types import OUTCOMES

INTRO = (
    "Look at, check, change and convert sessions.",
    "Each operation is the command of the same name: what is shown here can be repeated in a terminal, and nothing is "
    "replaced unless you say so.",
)
ANY = "any"


class Field(NamedTuple):
    """One option of a command."""

    name: str
    about: str
    option: str
    """``--out`` and the like; empty: the session comes twice (merge)."""
    kind: str
    """text, episode, outcome, format, session, switch."""
    proposal: str = ""
    """``{}`` stands for the session's name."""


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
        Field("min-contact", "Contact at the end, at least", "--min-contact", "text"),
        Field("max-contact", "Contact at the end, at most", "--max-contact", "text"),
        Field("min-steps", "Steps, at least", "--min-steps", "text"),
        Field("max-steps", "Steps, at most", "--max-steps", "text"),
    ),
    "merge": (Field("with", "With", "", "session"), _OUT),
    "trim": (
        _EPISODE, _OUT,
        Field("start", "First step to keep", "--start", "text", "0"),
        Field("stop", "Step after the last (empty: the end)", "--stop", "text"),
    ),
    "repair": (Field("out", "Write to (empty: in place)", "--out", "text"),),
    "export": (
        Field("format", "For", "--format", "format"), Field("out", "File or folder", "--out", "text", "{}-export"),
        _OUTCOME, Field("images", "With images (lerobot)", "--no-images", "switch", "on"),
    ),
    "import": (Field("out", "Session to write", "--out", "text", "{}-imported.h5"),
               Field("cloth", "Cloth (where it is not told)", "--cloth", "text")),
    "video": (_EPISODE, Field("out", "Film to write", "--out", "text", "{}.webm")),
    "plot": (Field("out", "Picture to write", "--out", "text", "{}.png"),),
}  # fmt: skip
"""Every command of `layflat data`, and its options; a test compares them with the command line."""
FORMATS = ("robomimic", "lerobot", "csv")
PATHS = ("out",)


@dataclass
class DataPage(CommandPage):
    name: str = "Data"
    session: str = ""
    operation: str = "info"
    values: dict[str, str] = field(default_factory=dict)
    """What was chosen or written, by the field's name."""
    force: bool = False
    intro: tuple[str, ...] = INTRO
    _rebuild: bool = False
    _ended: SubprocessCommand | None = None
    """The last command whose end was noticed."""

    def build(self) -> None:
        shop, width = self.shop, self.shop.place.panel.width
        self.menu = menu = menu_style.menu(shop.place.panel)
        menu_style.heading(menu, "Data")
        sessions = self._files()
        if not sessions:
            menu_style.note(menu, f"There is no session in {shop.folder}; record one first.", width)
            return
        self.session = self.session if self.session in sessions else sessions[0]
        menu_style.choice(menu, "Session", sessions, self.session, self._take_session, width=width)
        menu_style.choice(menu, "What to do", list(OPERATIONS), self.operation, self._take_operation, width=width)
        for item in OPERATIONS[self.operation]:
            self._build(menu, item, width)
        if any(item.name in PATHS for item in OPERATIONS[self.operation]):
            menu_style.switch(menu, "Replace if it exists", self.force, self._take_force)
        menu_style.button(menu, self.operation.capitalize(), self.start, main=True)
        menu_style.button(menu, "Cancel", self.cancel)

    def _files(self) -> list[str]:
        """Sessions; another tool's files too where they are to be imported."""
        files = self.shop.sessions()
        if self.operation != "import":
            return files
        return [*sorted(path.name for path in self.shop.folder.glob("*.hdf5")), *files]

    def _build(self, menu: pygame_menu.Menu, item: Field, width: int) -> None:
        value = self.values.setdefault(item.name, self._proposal(item))
        take = self._taker(item.name)
        known: Mapping[str, Callable[[], list[str]]] = {
            "episode": self._episodes, "outcome": lambda: [ANY, *OUTCOMES], "format": lambda: list(FORMATS),
            "session": lambda: [name for name in self.shop.sessions() if name != self.session],
        }  # fmt: skip
        if item.kind in known:
            names = known[item.kind]()
            value = value if value in names else names[0] if names else ""
            self.values[item.name] = value
            menu_style.choice(menu, item.about, names, value, take, width=width)
        elif item.kind == "switch":
            menu_style.switch(menu, item.about, value == "on", lambda on: take("on" if on else "off"))
        else:
            menu_style.entry(menu, item.about, value, take, width=width)

    def _proposal(self, item: Field) -> str:
        return item.proposal.replace("{op}", self.operation).replace("{}", self.session.rsplit(".", 1)[0])

    def _episodes(self) -> list[str]:
        try:
            with open_session(self.shop.folder / self.session) as session:
                return list(session.names)
        except (ValueError, OSError):
            return []

    def _taker(self, name: str) -> Callable[[str], None]:
        return lambda value: self.values.update({name: value.strip()})

    def _take_session(self, name: str) -> None:
        if name != self.session:
            self.session, self.values, self._rebuild = name, {}, True

    def _take_operation(self, name: str) -> None:
        if name != self.operation:
            self.operation, self.values, self._rebuild = name, {}, True

    def _take_force(self, on: bool) -> None:
        self.force = on

    def update(self) -> None:
        if self.job is not None and self.job.status is not None and self.job is not self._ended:
            # It may have made a session that can be chosen now.
            self._ended, self._rebuild = self.job, True
        if self._rebuild and self.menu is not None:
            self._rebuild = False
            self.build()

    def start(self) -> None:
        self.run(self.arguments())

    def arguments(self) -> list[str]:
        """The command line of what was chosen."""
        folder = self.shop.folder
        found = ["data", self.operation, str(folder / self.session)]
        fields = OPERATIONS[self.operation]
        for item in fields:
            value = self.values.get(item.name, self._proposal(item))
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
        return [*found, *(["--force"] if self.force and any(item.name in PATHS for item in fields) else [])]
