"""Workstation: everything that the viewers of one server share, advanced in one thread that never waits."""

from __future__ import annotations

import queue
import time
import traceback
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from layflat.app.support.errors import LayflatError, UsageError, format_error
from layflat.app.workstation import settings as settings_file
from layflat.app.workstation.session.client import SessionClient
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.session.status import Level
from layflat.app.workstation.settings import Settings
from layflat.app.workstation.subprocess_command import SubprocessCommand
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.app.workstation.time_series import TimeSeries
from layflat.app.workstation.web.folder import Folder
from layflat.app.workstation.web.inputs import Inputs
from layflat.app.workstation.web.operations import Commands
from layflat.sim.conditions.keys import Setting, as_texts

T = TypeVar("T")
ROUND_S = 0.01
"""Longest time until an input is read."""
SIMULATING = ("record", "evaluate")
"""Commands in the background to which the conditions apply."""
PAGE_S = 0.1
"""Time between two updates of the pages' numbers."""
RUNNING = ("countdown", "still", "running")


@dataclass
class Workstation:
    """The folder, the session, the commands in the background, and the viewers."""

    folder: Folder
    scratch: Path
    """Folder for films and plots that are shown and not kept."""
    make_viewer: Callable[[Workstation, Any], Any]
    """Makes the `Viewer` of a client."""
    debug: bool = False
    """Whether errors are printed with their traceback, too."""
    commands: Commands = field(default_factory=dict)
    """Commands of `layflat data` by name."""
    conditions: Mapping[str, Setting] = field(default_factory=dict)
    """Conditions of everything that is simulated, by key."""
    holder: str = ""
    """Name of the viewer in control; empty: the first one who acts gets it."""
    settings: Settings = field(init=False)
    session: SessionClient = field(default_factory=SessionClient)
    inputs: Inputs = field(default_factory=Inputs)
    jobs: dict[str, SubprocessCommand] = field(default_factory=dict)
    """Newest command in the background, by the page that started it."""
    series: TimeSeries = field(default_factory=TimeSeries)
    """Curves of the current take."""
    viewers: dict[int, Any] = field(default_factory=dict)
    _next: SessionRequest | None = None
    """Session to start once the one before has ended."""
    _work: queue.SimpleQueue[tuple[int | None, Callable[[], None]]] = field(default_factory=queue.SimpleQueue)
    _pool: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(2, "background"))
    _updated_s: float = 0.0

    def __post_init__(self) -> None:
        self.settings = settings_file.load(self.folder.path)

    # Viewers

    def connect(self, client: Any) -> None:
        """Show the pages to a client."""
        viewer = self.viewers[client.client_id] = self.make_viewer(self, client)
        request = self.session.request
        viewer.open("Place" if self.session.alive and request is not None and request.policy else "Record")

    def disconnect(self, client_id: int) -> None:
        """Forget a client; what it was in control of pauses."""
        viewer = self.viewers.pop(client_id, None)
        if viewer is None or self.holder != viewer.name:
            return
        self.take_control("")
        if self.session.alive and self.session.status.state in RUNNING:
            self.session.send_command(Command.PAUSE)
            self.note(f"{viewer.name}, who was in control, is gone; the take is paused", "warning")

    def take_control(self, viewer: str) -> None:
        """Give control to a viewer, or to the first one who acts (""); what a hand did ends."""
        self.holder, self.inputs.hand, self.inputs.drag = viewer, None, None

    def in_control(self, viewer: str) -> bool:
        """Return whether a viewer may change what runs."""
        return self.holder in ("", viewer)

    def require_control(self, viewer: str) -> None:
        """Give control to a viewer; LayflatError where another one has it."""
        if not self.in_control(viewer):
            raise LayflatError(f"{self.holder} is in control; press Take control to act yourself")
        self.holder = viewer

    def note(self, text: str, level: Level = "info") -> None:
        """Show a line to all viewers."""
        for viewer in self.viewers.values():
            viewer.say(text, level)

    # The session and commands

    def change_settings(self, **values: Any) -> None:
        """Take new settings, and keep them where the folder can be written."""
        new = replace(self.settings, **values)
        if new != self.settings:
            self.settings = new
            if not self.folder.read_only:
                settings_file.save(self.folder.path, new)

    def start(self, request: SessionRequest) -> None:
        """Start a session, once the one before has ended."""
        self.stop()
        self._next = replace(request, sim_config=request.sim_config.under(self.conditions))

    def stop(self) -> None:
        """Ask the session to end, with everything saved; a few rounds later it has."""
        self._next = None
        self.session.ask_end()

    def run(self, page: str, arguments: list[str]) -> None:
        """Start a command in the background, one a page."""
        if (job := self.jobs.get(page)) is not None:
            if job.running:
                raise UsageError("a command is running here; cancel it first")
            job.close()
        simulates = arguments[0] in SIMULATING
        given = [word for text in as_texts(self.conditions) for word in ("--set", text) if simulates]
        self.jobs[page] = SubprocessCommand([*arguments, *given])

    # Rounds

    def post(self, work: Callable[[], None], client_id: int | None = None) -> None:
        """Have the workstation's thread do this; an error is shown to the viewer."""
        self._work.put((client_id, work))

    def work(self, job: Callable[[], T], done: Callable[[T], None], client_id: int) -> None:
        """Do something that takes long beside the rounds, and then ``done`` with its result as one of them."""

        def run() -> None:
            try:
                result = job()
            except Exception as error:
                self.post(partial(_raise, error), client_id)
            else:
                self.post(lambda: done(result), client_id)

        self._pool.submit(run)

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
        if self._next is not None and not self.session.alive:
            request, self._next = self._next, None
            self.inputs.open(request.source, request.sim_config.robot_spec)
            self.series = TimeSeries()
            self.session.start(request)
        self.inputs.send(self.session)
        if self.session.frame is not None:
            self.series.add(self.session.frame)
        now = time.monotonic()
        whole = now - self._updated_s >= PAGE_S
        self._updated_s = now if whole else self._updated_s
        for client_id, viewer in list(self.viewers.items()):
            self._guarded(client_id, partial(viewer.update, whole=whole))

    def _do_work(self) -> None:
        timeout = ROUND_S
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
        """End everything, with all results saved; the only thing that waits."""
        self._pool.shutdown(wait=False, cancel_futures=True)
        for job in self.jobs.values():
            job.cancel()
        for event in self.session.end():
            self.note(event.text, event.level)
        self.inputs.close()
        for job in self.jobs.values():
            job.close()


def _raise(error: Exception) -> NoReturn:
    raise error
