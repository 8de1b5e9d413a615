"""SessionClient: the end of a session that a window, a terminal or a browser holds."""

from __future__ import annotations

import contextlib
import threading
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
class ControlToken:
    """Token of the viewer who is in control of a session; may be used from several threads."""

    holder: str = ""
    """Name of the viewer; empty: the first one who acts gets it."""
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def take(self, viewer: str, *, force: bool = False) -> bool:
        """Give control to a viewer; return False where another one has it, unless ``force``."""
        with self._lock:
            if force or self.holder in ("", viewer):
                self.holder = viewer
            return self.holder == viewer

    def release(self, viewer: str) -> None:
        """Give control back, where this viewer has it, such as when it is gone."""
        with self._lock:
            if self.holder == viewer:
                self.holder = ""


@dataclass
class SessionClient:
    """At most one session at a time, in a process of its own; may be used from several threads.

    Several viewers may show one client; of those only the one in `control` changes anything, and methods return False
    to the others. The name of a viewer is free; a program with one viewer leaves it out.
    """

    status: SessionStatus = field(default_factory=SessionStatus)
    """Newest status."""
    frame: SimulationFrame | None = None
    """Newest frame of the simulation."""
    request: SessionRequest | None = None
    """Newest request."""
    problem: str = ""
    """Why the last session ended by itself; empty where it was asked to, or was done."""
    control: ControlToken = field(default_factory=ControlToken)
    _wrong_call: bool = False
    """Whether the problem is one of the request."""
    _process: BaseProcess | None = None
    _connection: Connection | None = None
    _channels: Channels | None = None
    _read: list[int] = field(default_factory=lambda: [0, 0])
    """Numbers of the newest frame and status that were read."""
    _closing: bool = False
    """Whether the session was asked to end, or has reported that it ends."""
    _lock: threading.RLock = field(default_factory=threading.RLock)

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
        """Start a session, and end the one before; return at once."""
        with self._lock:
            self.end()
            self.request, self.status, self.frame = request, request.first_status(), None
            self.problem, self._wrong_call, self._read, self._closing = "", False, [0, 0], False
            context = start_fork_server()
            self._channels = Channels(context)
            self._connection, theirs = context.Pipe()
            arguments = request, self._channels, theirs
            self._process = context.Process(target=main, args=arguments, name="session", daemon=False)
            self._process.start()
            theirs.close()

    def send_command(self, command: Command, viewer: str = "") -> bool:
        """Send a command."""
        return self._send(viewer, "command", command)

    def disturb(self, name: str, viewer: str = "") -> bool:
        """Start a named disturbance."""
        return self._send(viewer, "disturb", name)

    def answer(self, yes: bool, viewer: str = "") -> bool:
        """Answer the question of the status."""
        return self._send(viewer, "answer", yes)

    def send_input(self, teleop: TeleopInput, drag: DragTarget | None = None, viewer: str = "") -> float:
        """Replace the newest input; return its stamp, or 0 where another viewer is in control."""
        with self._lock:
            if self._channels is None or not self.control.take(viewer):
                return 0.0
            stamped = replace(teleop, commands=(), stamp_s=time.monotonic())
            self._channels.inputs.write((stamped, drag))
            return stamped.stamp_s

    def poll(self) -> list[SessionEvent]:
        """Update `status` and `frame`, and notice where the session has ended; return what must be shown once."""
        with self._lock:
            process, connection = self._process, self._connection
            if process is None or connection is None:
                return []
            ended = not process.is_alive()
            events = self._update(connection)
            if ended:
                if not self._closing:
                    how = describe_exit_status(process.exitcode, END_S)
                    self.problem = (
                        f"the session was lost: {how}; kept episodes are safe, and the next recording saves the steps"
                        " of a running one as partial"
                    )
                self._release(process, connection)
            return events

    def end(self) -> list[SessionEvent]:
        """End the session and wait until everything is durable; return its last events."""
        with self._lock:
            process, connection = self._process, self._connection
            if process is None or connection is None:
                return []
            self._send_now("end")
            self._closing = True
            events: list[SessionEvent] = []
            end_s = time.monotonic() + END_S
            while process.is_alive():
                # Its events are read while it ends: a full pipe would block it.
                events += self._update(connection)
                process.join(0.05)
                if time.monotonic() > end_s:
                    process.kill()
            events += self._update(connection)
            self._release(process, connection)
            return events

    def check(self) -> None:
        """Raise the error with which the session ended by itself."""
        if self.problem:
            raise (UsageError if self._wrong_call else LayflatError)(self.problem)

    def _send(self, viewer: str, *request: Any) -> bool:
        with self._lock:
            if not self.control.take(viewer):
                return False
            self._send_now(*request)
            return True

    def _send_now(self, *request: Any) -> None:
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

    def _release(self, process: BaseProcess, connection: Connection) -> None:
        process.join(1.0)
        process.close()
        connection.close()
        self._process = self._connection = self._channels = None
