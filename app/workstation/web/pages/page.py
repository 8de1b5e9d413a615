"""Page: base of what a viewer shows beside the scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import viser

from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.web.viewer import Viewer
from layflat.app.workstation.web.widgets import sentence
from layflat.data.session.reader import open_session


class Page:
    """One tab of one viewer. A page overrides what it needs."""

    name = ""

    def __init__(self, viewer: Viewer) -> None:
        self.viewer = viewer
        self.workstation = viewer.workstation
        self.folder = viewer.workstation.folder

    @property
    def gui(self) -> viser.GuiApi:
        """Container of the page's parts."""
        return self.viewer.client.gui

    def build(self) -> None:
        """Add the page's parts."""

    def update(self) -> None:
        """Show the newest numbers."""

    def frames(self) -> Sequence[SimulationFrame]:
        """Return what the scene shows: what runs, unless the page has something of its own."""
        frame = self.workstation.session.frame
        return () if frame is None else (frame,)

    def close(self) -> None:
        """Handle that another page is shown."""

    # Parts

    def note(self, text: str) -> None:
        """Add a sentence."""
        self.gui.add_html(sentence(text))

    def button(
        self, label: str, work: Callable[[], None], *, control: bool = False, color: Any = None, hint: str | None = None
    ) -> viser.GuiButtonHandle:
        """Add a button; ``control``: it changes what all viewers share."""
        handle = self.gui.add_button(label, color=color, hint=hint)
        self.viewer.on_click(handle, work, control=control)
        return handle

    def choice(
        self, label: str, options: Sequence[str], value: str, change: Callable[[str], None], hint: str | None = None
    ) -> viser.GuiDropdownHandle[str]:
        """Add a list to choose from; the first option is taken where ``value`` is none of them."""
        handle = self.gui.add_dropdown(
            label, tuple(options), initial_value=value if value in options else options[0], hint=hint
        )
        # What a browser sends need not be one of the options.
        self.viewer.on_change(handle, lambda: change(handle.value) if handle.value in options else None)
        return handle

    def setting(self, name: str) -> Callable[[Any], None]:
        """Return a function that changes a setting of the workstation."""
        return lambda value: self.workstation.change_settings(**{name: value})

    def session_choice(self, value: str, change: Callable[[str], None], label: str = "Session") -> str:
        """Add a list of sessions; return the chosen one, or "" where there is none, which is then said."""
        names = self.folder.sessions()
        if not names:
            self.note("There is no session in this folder; record one first.")
            return ""
        return str(self.choice(label, names, value, change).value)

    def episode_names(self, session: str) -> list[str]:
        """Return the names of a session's episodes; none where it cannot be read, which is shown."""
        try:
            with open_session(self.folder.session(session)) as opened:
                return list(opened.names)
        except Exception as error:
            self.viewer.say(str(error), "error")
            return []
