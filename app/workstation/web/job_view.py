"""JobView: a command in the background, with its progress, output, result and a button that cancels it."""

from __future__ import annotations

from layflat.app.workstation.session.status import Level
from layflat.app.workstation.subprocess_command import SubprocessCommand
from layflat.app.workstation.web.viewer import Viewer
from layflat.app.workstation.web.widgets import output, put, sentence

ERROR = "layflat: "
"""Beginning of the sentence with which a command fails."""


class JobView:
    """The newest command that a page has started, for any viewer of that page."""

    def __init__(self, viewer: Viewer, name: str) -> None:
        """Add its parts to the viewer's page; ``name`` tells commands of different pages apart."""
        self._viewer = viewer
        self._name = name
        self._ended: SubprocessCommand | None = self.job if self.job is not None and not self.job.running else None
        gui = viewer.client.gui
        self._line = gui.add_html("")
        self._bar = gui.add_progress_bar(0.0, visible=False)
        self._cancel = gui.add_button("Cancel", color="orange", visible=False)
        viewer.on_click(self._cancel, lambda: self.job.cancel() if self.job else None, control=True)
        self._output = gui.add_html("")
        self.update()

    @property
    def job(self) -> SubprocessCommand | None:
        """The newest command; None before the first."""
        return self._viewer.workstation.jobs.get(self._name)

    @property
    def succeeded(self) -> bool:
        """Whether the newest command ended with its result."""
        return self.job is not None and self.job.status == 0

    def start(self, arguments: list[str]) -> None:
        """Start a command."""
        self._viewer.workstation.run(self._name, arguments)
        self.update()

    def update(self) -> bool:
        """Show how it is; return True once when it has ended."""
        job = self.job
        running = job is not None and job.running
        put(self._bar, visible=running)
        put(self._cancel, visible=running)
        if job is None:
            return False
        if running:
            put(self._bar, value=round(100 * job.progress, 1))
            put(self._line, content=sentence(job.activity or "starting"))
        else:
            failed = next((line for line in job.lines if line.startswith(ERROR)), "") if job.status else ""
            level: Level = "success" if job.status == 0 else "warning" if job.cancelled else "error"
            put(self._line, content=sentence(failed.removeprefix(ERROR) or job.outcome(), level))
        put(self._output, content=output([f"$ {job.describe()}", *job.lines]))
        ended = not running and job is not self._ended
        self._ended = job if ended else self._ended
        return ended
