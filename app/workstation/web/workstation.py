"""Workstation: everything that the viewers of one server share, advanced in one thread."""

from __future__ import annotations

import queue
import time
import traceback
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from layflat.app.support.errors import LayflatError, UsageError, format_error
from layflat.app.workstation import settings as settings_file
from layflat.app.workstation.session.client import SessionClient
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.session.status import Level, Message
from layflat.app.workstation.settings import Settings
from layflat.app.workstation.subprocess_command import SubprocessCommand
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.app.workstation.time_series import TimeSeries
from layflat.app.workstation.web.folder import Folder
from layflat.app.workstation.web.inputs import Inputs

ROUND_S = 0.01
"""Longest time until an input is read."""
PAGE_S = 0.1
"""Time between two updates of the pages' numbers."""
RUNNING = ("countdown", "still", "running")


class View(Protocol):
    """A viewer as the workstation needs it."""

    name: str

    def open(self, name: str) -> None:
        """Show a page."""

    def say(self, text: str, level: Level = "info") -> None:
        """Show a sentence above the page."""

    def update(self, *, whole: bool) -> None:
        """Show the newest frame, and, where ``whole``, the newest numbers."""


@dataclass
class Workstation:
    """The folder, the session, the commands in the background, and the viewers."""

    folder: Folder
    scratch: Path
    """Folder for films and plots that are shown and not kept."""
    make_viewer: Callable[[Workstation, Any], View]
    """Makes the viewer of a client."""
    debug: bool = False
    """Whether errors are printed with their traceback, too."""
    settings: Settings = field(init=False)
    session: SessionClient = field(default_factory=SessionClient)
    inputs: Inputs = field(default_factory=Inputs)
    jobs: dict[str, SubprocessCommand] = field(default_factory=dict)
    """Newest command in the background, by the page that started it."""
    series: TimeSeries = field(default_factory=TimeSeries)
    """Curves of the current take."""
    viewers: dict[int, View] = field(default_factory=dict)
    log: deque[Message] = field(default_factory=lambda: deque(maxlen=5))
    """Newest lines about takes."""
    _work: queue.SimpleQueue[tuple[int | None, Callable[[], None]]] = field(default_factory=queue.SimpleQueue)
    _updated_s: float = 0.0

    def __post_init__(self) -> None:
        self.settings = settings_file.load(self.folder.path)

    # Viewers

    def connect(self, client: Any) -> None:
        """Show the pages to a client."""
        viewer = self.viewers[client.client_id] = self.make_viewer(self, client)
        viewer.open(
            "Place" if self.session.alive and self.session.request and self.session.request.policy else "Record"
        )

    def disconnect(self, client_id: int) -> None:
        """Forget a client; what it was in control of pauses."""
        viewer = self.viewers.pop(client_id, None)
        if viewer is None:
            return
        if self.session.control.holder == viewer.name:
            self.inputs.hand = self.inputs.drag = None
            if self.session.alive and self.session.status.state in RUNNING:
                self.session.send_command(Command.PAUSE, viewer.name)
                self.note(f"{viewer.name}, who was in control, is gone; the take is paused", "warning")
            self.session.control.release(viewer.name)

    def in_control(self, viewer: str) -> bool:
        """Return whether a viewer may change what runs."""
        return self.session.control.holder in ("", viewer)

    def require_control(self, viewer: str) -> None:
        """Give control to a viewer; LayflatError where another one has it."""
        if not self.session.control.take(viewer):
            holder = self.session.control.holder
            raise LayflatError(f"{holder} is in control; press Take control to act yourself")

    def post(self, work: Callable[[], None], client_id: int | None = None) -> None:
        """Have the workstation's thread do this; an error is shown to the viewer."""
        self._work.put((client_id, work))

    def note(self, text: str, level: Level = "info") -> None:
        """Show a line to all viewers."""
        self.log.append(Message(text=text, level=level))
        for viewer in self.viewers.values():
            viewer.say(text, level)

    # The session and commands

    def change_settings(self, **values: Any) -> None:
        """Take new settings, and keep them where the folder can be written."""
        new = self.settings
        for name, value in values.items():
            new = new.with_value(name, value)
        if new != self.settings:
            self.settings = new
            if not self.folder.read_only:
                settings_file.save(self.folder.path, new)

    def start(self, request: SessionRequest) -> None:
        """Start a session."""
        self.stop()
        self.inputs.open(request.source, request.sim_config.robot_spec)
        self.series = TimeSeries()
        self.session.start(request)

    def stop(self) -> None:
        """End the session, with everything saved."""
        for event in self.session.end():
            self.note(event.text, event.level)
        self.inputs.close()

    def run(self, page: str, arguments: list[str]) -> None:
        """Start a command in the background, one a page."""
        if (job := self.jobs.get(page)) is not None:
            if job.running:
                raise UsageError("a command is running here; cancel it first")
            job.close()
        self.jobs[page] = SubprocessCommand(arguments, folder=self.folder.path)

    # Rounds

    def round(self) -> None:
        """Do what was posted, read the inputs and show what is new."""
        self._do_work()
        alive = self.session.alive
        for event in self.session.poll():
            self.note(event.text, event.level)
        if alive and not self.session.alive:
            self.inputs.close()
            if self.session.problem:
                self.note(self.session.problem, "error")
        self.inputs.send(self.session)
        if self.session.frame is not None:
            self.series.add(self.session.frame)
        now = time.monotonic()
        whole = now - self._updated_s >= PAGE_S
        self._updated_s = now if whole else self._updated_s
        for client_id, viewer in list(self.viewers.items()):
            self._guarded(client_id, lambda viewer=viewer: viewer.update(whole=whole))  # type: ignore[misc]

    def _do_work(self) -> None:
        timeout: float = ROUND_S
        while True:
            try:
                client_id, work = self._work.get(timeout=timeout) if timeout else self._work.get_nowait()
            except queue.Empty:
                return
            timeout = 0.0
            self._guarded(client_id, work)

    def _guarded(self, client_id: int | None, work: Callable[[], None]) -> None:
        """Show an error where it was caused."""
        try:
            work()
        except Exception as error:
            if self.debug:
                traceback.print_exc()
            viewer = None if client_id is None else self.viewers.get(client_id)
            if viewer is not None:
                viewer.say(format_error(error)[0], "error")

    def close(self) -> None:
        """End everything, with all results saved."""
        for job in self.jobs.values():
            job.cancel()
        self.stop()
        for job in self.jobs.values():
            job.close()
