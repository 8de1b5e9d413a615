"""LivePage: a form until a session runs, and then the session."""

from __future__ import annotations

from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.session.status import Mode
from layflat.app.workstation.web.live_panel import LivePanel
from layflat.app.workstation.web.pages.page import Page


class LivePage(Page):
    """Base of the pages that run a session."""

    modes: tuple[Mode, ...] = ()
    """Sessions that the page shows."""
    _panel: LivePanel | None = None

    def build_form(self) -> None:
        """Add the form."""

    def build(self) -> None:
        """Add the form, or the running session."""
        session = self.workstation.session
        self._panel = None
        if not session.alive:
            self.build_form()
        elif session.status.mode in self.modes:
            self._panel = LivePanel(self.viewer)
            self.button("End", self._end, control=True, color="gray", hint="Ends it; a running take is kept as partial.")
        else:
            self.note("Another session is running; end it on its page before you start one here.")
        self._alive = session.alive

    def update(self) -> None:
        """Show the newest status, and the form again when the session has ended."""
        if self._alive != self.workstation.session.alive:
            self.close()
            self.viewer.rebuild()
        elif self._panel is not None:
            self._panel.update()

    def close(self) -> None:
        """Take the keys of the session away."""
        if self._panel is not None:
            self._panel.close()

    def _end(self) -> None:
        self.workstation.stop()

    def start(self, request: SessionRequest) -> None:
        """Start a session."""
        self.viewer.say("")
        self.workstation.start(request)
