"""LivePage: a form until a session runs, and then the session."""

from __future__ import annotations

from collections.abc import Sequence

from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.session.status import Mode
from layflat.app.workstation.web.live_panel import LivePanel
from layflat.app.workstation.web.pages.page import Page


class LivePage(Page):
    """Base of the pages that run a session."""

    modes: tuple[Mode, ...] = ()
    """Sessions that the page shows."""
    _panel: LivePanel | None = None
    _touched = False
    """Whether a choice of the form was changed since something ran."""

    def build_form(self) -> None:
        """Add the form."""

    def build(self) -> None:
        """Add the form, or the running session."""
        session = self.workstation.session
        self._panel, self._touched, self._alive = None, False, session.alive
        if not session.alive:
            self.build_form()
            self._touched = False
        elif session.status.mode in self.modes:
            self._panel = LivePanel(self.viewer)
            self.button(
                "End", self._end, control=True, color="gray", hint="Ends it; a running take is kept as partial."
            )
        else:
            self.note("Another session is running; end it on its page before you start one here.")

    def preview(self) -> SimulationFrame | None:
        """Return what would be started."""
        return None

    def frames(self) -> Sequence[SimulationFrame]:
        """Return what runs; else what has just ended, or would be started."""
        session, preview = self.workstation.session, self.preview()
        if preview is None or session.alive or (session.frame is not None and not self._touched):
            return super().frames()
        return (preview,)

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
