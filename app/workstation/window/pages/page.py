"""Page: base of the window's pages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import pygame
import pygame_menu

from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.time_series import TimeSeries
from layflat.app.workstation.window import style
from layflat.app.workstation.window.context import FormRow, KeyHint, WindowContext
from layflat.app.workstation.window.menu_style import Form
from layflat.data.session.reader import open_session

ASK_AGAIN_S = 3.0
"""Time within which a second request ends what the first one only asked about."""
MENU_HINTS = (KeyHint("Enter", "choose and press in the menu"), KeyHint("mouse", "turn, zoom and pan the view"))
Shows: TypeAlias = Literal["simulation", "text"]


@dataclass
class Page:
    """One tab of the window. A page overrides what it needs."""

    context: WindowContext
    name: str = ""
    shows: Shows = "simulation"
    menu: pygame_menu.Menu | None = None
    """Content of the panel; None: ``rows`` instead."""
    session: str = ""
    """Session file that is chosen."""
    seed: int = 0
    rebuild: bool = False
    """Whether the menu is made again in the next frame: not while one of its fields is changed."""
    past: TimeSeries = field(default_factory=TimeSeries)

    def enter(self) -> None:
        """Handle that the tab was chosen."""
        self.build()

    def leave(self) -> None:
        """Handle that another tab was chosen: end what runs and save its results."""
        self.context.client.end()
        self.context.client.frame, self.context.client.status = None, {}

    def close(self) -> None:
        """Handle the end of the window: end what this page has started."""

    def build(self) -> None:
        """Make the menu."""

    def busy(self) -> str:
        """Return what would be ended by leaving, for a person; empty where nothing would."""
        return ""

    def handle_event(self, event: pygame.event.Event) -> bool:
        """Handle a key, or the mouse in the view; return whether it had an effect here."""
        return False

    def update(self) -> None:
        """Advance by one frame of the window."""
        frame = self.frame()
        if frame is not None:
            self.past.add(frame)
        if self.rebuild and self.menu is not None:
            self.rebuild = False
            self.build()

    def on_resize(self) -> None:
        """Handle that the window has another size."""
        if self.menu is not None:
            self.build()

    def on_event(self, events: list[dict[str, Any]]) -> None:
        """Handle events of the activity since the last frame."""

    def key_hints(self) -> list[KeyHint]:
        """Return the effect of each button now."""
        return list(MENU_HINTS)

    def rows(self) -> list[FormRow]:
        """Return the panel while there is no menu."""
        return []

    def headline(self) -> tuple[str, style.Color]:
        """Return the panel's first line while there is no menu."""
        return self.name, style.TEXT

    def banner(self) -> tuple[str, str]:
        """Return large words over the view, and small ones below them; empty where there are none."""
        return "", ""

    def frame(self) -> SimulationFrame | None:
        """Return what the view shows."""
        return self.context.client.frame

    def series(self) -> tuple[TimeSeries, float | None]:
        """Return the curves, and the time that is marked in them."""
        return self.past, None

    def draw_over(self, surface: pygame.Surface) -> None:
        """Draw something on the view."""

    def draw_text(self, surface: pygame.Surface) -> None:
        """Draw the content of a page without a simulation."""

    def accepts_drag(self) -> bool:
        """Return whether the mouse may drag the cloth now."""
        return False

    # Parts of menus

    def new_form(self, title: str) -> Form:
        """Start the menu."""
        form = Form(self.context.layout.panel, title)
        self.menu = form.menu
        return form

    def session_form(self, title: str, label: str, sessions: list[str] | None = None) -> Form | None:
        """Start the menu with a choice of sessions; None where there is none, which the menu then says."""
        form = self.new_form(title)
        sessions = self.context.sessions() if sessions is None else sessions
        if not sessions:
            form.note(f"There is no session in {self.context.folder}; record one first.")
            return None
        self.session = self.session if self.session in sessions else sessions[0]
        form.choice(label, sessions, self.session, self.choose_session)
        return form

    def choose_session(self, name: str) -> None:
        """Take another session."""
        if name != self.session:
            self.session, self.rebuild = name, True

    def set_seed(self, text: str) -> None:
        """Take a seed, if it is one."""
        self.seed = int(text) if text.isdigit() and int(text) < 2**32 else self.seed

    def setting(self, name: str) -> Callable[[Any], None]:
        """Return a function that changes a setting of the window."""
        return lambda value: self.context.change_settings(self.context.settings.with_value(name, value))

    def episode_names(self) -> list[str]:
        """Return the names of the session's episodes; none where it cannot be read, which is shown."""
        try:
            with open_session(self.context.folder / self.session) as session:
                return list(session.names)
        except (ValueError, OSError) as error:
            self.context.show_message(str(error), style.WARNING)
            return []
