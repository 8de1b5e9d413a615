"""The seam between the window and its modes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol, TypeAlias

import pygame
import pygame_menu

from layflat.app.workstation.session.bench_client import BenchClient
from layflat.app.workstation.session.frame_channel import BenchFrame
from layflat.app.workstation.teleop import Button, Command
from layflat.app.workstation.window import settings, style
from layflat.app.workstation.window.layout import WindowLayout
from layflat.app.workstation.window.settings import Settings
from layflat.app.workstation.window.time_series import TimeSeries
from layflat.data.types import DragTarget

ASK_AGAIN_S = 3.0
"""What would end something is asked for twice within this time."""
Shows: TypeAlias = Literal["bench", "text"]


class KeyHint(NamedTuple):
    """One button: what it is called, what it does now, and doing it (a click does, too)."""

    key: str
    does: str
    act: Callable[[], None] | None = None
    colour: style.Colour = style.TEXT


CONTROL_COLOURS = {
    Command.START: style.ACCENT,
    Command.KEEP_SUCCESS: style.CONTACT,
    Command.KEEP_FAILURE: style.WORD,
    Command.DISCARD: style.WARNING,
}


def device_chips(
    buttons: Iterable[Button], does: Mapping[str, str | None], press: Callable[[Command], None]
) -> list[KeyHint]:
    """A device's buttons that do something now (``does``, by the control's name), and then what moves."""
    acting, moving = [], []
    for button in buttons:
        if button.control is None:
            moving.append(KeyHint(button.name, button.does))
        elif now := does.get(button.control.name):
            colour = CONTROL_COLOURS.get(button.control, style.TEXT)
            acting.append(KeyHint(button.name, now, partial(press, button.control), colour))
    return acting + moving


class FormRow(NamedTuple):
    """A line of a panel: a name and what stands for it."""

    name: str
    value: str
    colour: style.Colour = style.TEXT


@dataclass
class WindowContext:
    """What all modes share."""

    folder: Path
    settings: Settings
    remember: bool
    """Whether settings outlive the window."""
    link: BenchClient
    place: WindowLayout
    message: str = ""
    """The newest sentence, in the line below the bench."""
    message_colour: style.Colour = style.QUIET
    pull: DragTarget | None = None
    """What the mouse pulls at now."""

    def say(self, sentence: str, colour: style.Colour = style.QUIET) -> None:
        self.message, self.message_colour = sentence, colour

    def change(self, new: Settings) -> None:
        """Remember settings, for the next time as well."""
        if new != self.settings:
            self.settings = new
            if self.remember:
                settings.save(self.folder, new)

    def sessions(self) -> list[str]:
        """Session files of the folder, the newest first."""
        return _newest(self.folder, "*.h5")

    def models(self) -> list[str]:
        return _newest(self.folder, "*.npz")


def _newest(folder: Path, pattern: str) -> list[str]:
    found = [path for path in folder.glob(pattern) if path.is_file()]
    return [path.name for path in sorted(found, key=lambda path: path.stat().st_mtime, reverse=True)]


class Page(Protocol):
    """One tab of the window."""

    name: str
    shows: Shows
    menu: pygame_menu.Menu | None
    """What the panel holds; None: ``rows`` instead."""

    def enter(self) -> None:
        """The tab is chosen."""

    def leave(self) -> None:
        """Another one is; ends what runs, with everything kept that is to be kept."""

    def close(self) -> None:
        """The window ends, and with it what this mode has started."""

    def busy(self) -> str:
        """What would be ended by leaving, for a person; empty where there is nothing."""

    def handle(self, event: pygame.event.Event) -> bool:
        """A key, or the mouse in the view; True where it meant something here."""

    def update(self) -> None:
        """Once a frame."""

    def relaid(self) -> None:
        """The window has another size."""

    def chips(self) -> list[KeyHint]:
        """What each button does now."""

    def rows(self) -> list[FormRow]:
        """The panel while there is no menu."""

    def headline(self) -> tuple[str, style.Colour]:
        """The panel's first line while there is no menu."""

    def hear(self, messages: list[dict[str, Any]]) -> None:
        """What the bench said since the last frame."""

    def banner(self) -> tuple[str, str]:
        """Large words over the bench, and small ones below them; empty where there are none."""

    def moment(self) -> BenchFrame | None:
        """What the view shows."""

    def history(self) -> tuple[TimeSeries, float | None]:
        """The curves, and the moment that is marked in them."""

    def paint_over(self, surface: pygame.Surface) -> None:
        """Draw something on the view."""

    def paint_text(self, surface: pygame.Surface) -> None:
        """Draw what a mode without a bench has to say."""

    def pullable(self) -> bool:
        """Whether the mouse may pull at the cloth now."""


@dataclass
class BasePage:
    """What most modes have in common."""

    shop: WindowContext
    name: str = ""
    shows: Shows = "bench"
    menu: pygame_menu.Menu | None = None
    past: TimeSeries = field(default_factory=TimeSeries)

    def enter(self) -> None:
        self.build()

    def leave(self) -> None:
        self.shop.link.end()
        self.shop.link.moment, self.shop.link.status = None, {}

    def close(self) -> None:
        """Nothing but the bench, which the window ends."""

    def build(self) -> None:
        """Make the menu."""

    def busy(self) -> str:
        return ""

    def handle(self, event: pygame.event.Event) -> bool:
        return False

    def update(self) -> None:
        moment = self.moment()
        if moment is not None:
            self.past.add(moment)

    def relaid(self) -> None:
        if self.menu is not None:
            self.build()

    def chips(self) -> list[KeyHint]:
        return []

    def rows(self) -> list[FormRow]:
        return []

    def headline(self) -> tuple[str, style.Colour]:
        return self.name, style.TEXT

    def hear(self, messages: list[dict[str, Any]]) -> None:
        """Nothing."""

    def banner(self) -> tuple[str, str]:
        return "", ""

    def moment(self) -> BenchFrame | None:
        return self.shop.link.moment

    def history(self) -> tuple[TimeSeries, float | None]:
        return self.past, None

    def paint_over(self, surface: pygame.Surface) -> None:
        """Nothing."""

    def paint_text(self, surface: pygame.Surface) -> None:
        """Nothing."""

    def pullable(self) -> bool:
        return False
