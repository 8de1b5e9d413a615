"""SessionClient: the end of a session that a window, a terminal or a browser holds."""

from __future__ import annotations

import contextlib
import time
from dataclasses import dataclass, field, replace
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

from layflat.app.support.child_python import fork_server_context
from layflat.app.support.errors import USAGE_ERROR, LayflatError, UsageError
from layflat.app.workers.process import describe_exit_status
from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.session.server import Channels, Failure, main
from layflat.app.workstation.session.status import SessionEvent, SessionStatus
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput
from layflat.data.robot import RobotSpec
from layflat.data.types import DragTarget

END_S = 20.0
"""Time for a process to make everything durable when it is asked to end; assembling a large session takes some."""
PRELOAD = ["layflat.app.workstation.session.server"]


def start_fork_server() -> Any:
    """Start the server from which sessions are forked: it imports for a second or two while the person looks around."""
    return fork_server_context(PRELOAD)


@dataclass
class SessionClient:
    """At most one session at a time, in a process of its own. Only `end`, and a `start` that ends one, wait."""

    status: SessionStatus = field(default_factory=SessionStatus)
    """Newest status."""
    frame: SimulationFrame | None = None
    """Newest frame of the simulation."""
    request: SessionRequest | None = None
    """Newest request."""
    problem: str = ""
    """Why the last session ended by itself; empty where it was asked to, or was done."""
    _wrong_call: bool = False
    """Whether the problem is one of the request."""
    _process: BaseProcess | None = None
    _connection: Connection | None = None
    _channels: Channels | None = None
    _read: list[int] = field(default_factory=lambda: [0, 0])
    """Numbers of the newest frame and status that were read."""
    _closing: bool = False
    """Whether the session was asked to end, or has reported that it ends."""
    _end_s: float | None = None
    """When a session that was asked to end is killed."""

    @property
    def robot(self) -> RobotSpec | None:
        """Robot of the newest request."""
        return None if self.request is None else self.request.sim_config.robot_spec

    @property
    def alive(self) -> bool:
        """Whether there is a session."""
        return self._process is not None

    @property
    def pid(self) -> int | None:
        """Number of the session's process."""
        return None if self._process is None else self._process.pid

    def start(self, request: SessionRequest) -> None:
        """Start a session, and end the one before; return at once where there is none."""
        self.end()
        self.request, self.status, self.frame = request, request.first_status(), None
        self.problem, self._wrong_call, self._read, self._closing, self._end_s = "", False, [0, 0], False, None
        context = start_fork_server()
        self._channels = Channels(context)
        self._connection, theirs = context.Pipe()
        arguments = request, self._channels, theirs
        self._process = context.Process(target=main, args=arguments, name="session", daemon=False)
        self._process.start()
        theirs.close()

    def send_command(self, command: Command) -> None:
        """Send a command."""
        self._send("command", command)

    def disturb(self, name: str) -> None:
        """Start a named disturbance."""
        self._send("disturb", name)

    def answer(self, yes: bool) -> None:
        """Answer the question of the status."""
        self._send("answer", yes)

    def send_input(self, teleop: TeleopInput, drag: DragTarget | None = None) -> float:
        """Replace the newest input; return its stamp, or 0 where there is no session."""
        if self._channels is None:
            return 0.0
        stamped = replace(teleop, commands=(), stamp_s=time.monotonic())
        self._channels.inputs.write((stamped, drag))
        return stamped.stamp_s

    def poll(self) -> list[SessionEvent]:
        """Update `status` and `frame`, and notice where the session has ended; return what must be shown once."""
        process, connection = self._process, self._connection
        if process is None or connection is None:
            return []
        if self._end_s is not None and time.monotonic() > self._end_s:
            process.kill()
        ended = not process.is_alive()
        events = self._update(connection)
        if ended:
            if not self._closing:
                how = describe_exit_status(process.exitcode, END_S)
                self.problem = (
                    f"the session was lost: {how}; kept episodes are safe, and the next recording saves the steps"
                    " of a running one as partial"
                )
            process.join(1.0)
            process.close()
            connection.close()
            self._process = self._connection = self._channels = None
        return events

    def ask_end(self) -> None:
        """Ask the session to end, with everything durable; `poll` notices when it has."""
        if self.alive and self._end_s is None:
            self._send("end")
            self._closing, self._end_s = True, time.monotonic() + END_S

    def end(self) -> list[SessionEvent]:
        """End the session and wait until everything is durable; return its last events."""
        self.ask_end()
        events: list[SessionEvent] = []
        while self._process is not None:
            self._process.join(0.05)
            events += self.poll()  # While it ends: a full pipe would block it.
        return events

    def check(self) -> None:
        """Raise the error with which the session ended by itself."""
        if self.problem:
            raise (UsageError if self._wrong_call else LayflatError)(self.problem)

    def _send(self, *request: Any) -> None:
        with contextlib.suppress(OSError):  # It has ended; `poll` will report it.
            if self._connection is not None:
                self._connection.send(request)

    def _update(self, connection: Connection) -> list[SessionEvent]:
        """Read the channels, and return the events that have come."""
        events: list[SessionEvent] = []
        with contextlib.suppress(EOFError, OSError):
            while connection.poll():
                event = connection.recv()
                if isinstance(event, SessionEvent):
                    events.append(event)
                    continue
                self._closing = True
                if isinstance(event, Failure):
                    self.problem, self._wrong_call = event.problem, event.exit_status == USAGE_ERROR
        if self._channels is not None:
            frame, status = self._channels.frames.read(self._read[0]), self._channels.status.read(self._read[1])
            if frame is not None:
                self._read[0], self.frame = frame
            if status is not None:
                self._read[1], self.status = status
        return events
