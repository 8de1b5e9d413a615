"""ActivityClient: the window's end of an activity's process."""

from __future__ import annotations

from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

from layflat.app.support.child_python import fork_server_context
from layflat.app.workers.process import describe_exit_status
from layflat.app.workstation.session.activity_process import ActivityFactory, Channels, main, receive, send
from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.session.requests import ActivityRequest
from layflat.app.workstation.teleop.teleop_input import TeleopInput
from layflat.data.robot import RobotSpec
from layflat.data.types import DragTarget

END_S = 20.0
"""Time for a process to make everything durable when it is asked to end; assembling a large session takes some."""
PRELOAD = ["layflat.app.workstation.session.activities"]


def start_fork_server() -> Any:
    """Start the server from which activities are forked: it imports for a second or two while the person looks around.

    Activities are processes that have never stepped a simulation.
    """
    return fork_server_context(PRELOAD)


@dataclass
class ActivityClient:
    """At most one process at a time; a new request ends the previous one."""

    make: ActivityFactory
    problem: str = ""
    """Why the last process ended by itself; empty where it was asked to, or was done."""
    status: dict[str, Any] = field(default_factory=dict)
    """Newest status of the activity."""
    frame: SimulationFrame | None = None
    """Newest frame of the simulation."""
    robot: RobotSpec | None = None
    """Robot of the newest request."""
    _process: BaseProcess | None = None
    _connection: Connection | None = None
    _channels: Channels | None = None
    _read: list[int] = field(default_factory=lambda: [0, 0])
    """Numbers of the newest frame and status that were read."""
    _closing: bool = False
    _done: bool = False
    """Whether the process has reported that it ends, or why it failed."""

    def start(self, request: ActivityRequest) -> None:
        """Start a process for this request; return at once."""
        self.end()
        self.problem, self.status, self._read = "", {}, [0, 0]
        self._closing = self._done = False
        context = start_fork_server()
        self._channels, self.robot = Channels(context), request.sim_config.robot_spec
        self._connection, theirs = context.Pipe()
        process = context.Process(
            target=main, args=(self.make, request, self._channels, theirs), name="activity", daemon=False
        )
        process.start()
        self._process = process
        theirs.close()

    @property
    def alive(self) -> bool:
        """Whether there is a process."""
        return self._process is not None

    @property
    def pid(self) -> int | None:
        """Number of the process."""
        return None if self._process is None else self._process.pid

    def request(self, request: str, **values: Any) -> None:
        """Send a request to the activity; do nothing where there is none any more."""
        if self._connection is None:
            return
        try:
            send(self._connection, {"request": request, **values})
        except OSError:
            return  # It has ended; `poll_events` will report it.

    def send_input(self, teleop: TeleopInput, drag: DragTarget | None = None) -> float:
        """Replace the newest input; return its stamp."""
        return 0.0 if self._channels is None else self._channels.inputs.write(teleop, drag)

    def poll_events(self) -> list[dict[str, Any]]:
        """Return new events, update `frame` and `status`, and notice where the process has ended."""
        process, connection = self._process, self._connection
        if process is None or connection is None:
            return []
        ended = not process.is_alive()
        events = self._update(connection)
        failed = [event["problem"] for event in events if event["event"] == "failed"]
        if failed:
            self.problem = failed[-1]
        self._done = self._done or bool(failed) or any(event["event"] == "ended" for event in events)
        if ended:
            if not (self._closing or self._done):
                self.problem = (
                    f"the simulation was lost: {describe_exit_status(process.exitcode, END_S)}; saved episodes are"
                    " safe, and the next recording saves the steps of a running one as partial"
                )
            self._release()
        return events

    def end(self) -> list[dict[str, Any]]:
        """Ask the process to end, and wait until everything is durable; return its last events."""
        process, connection = self._process, self._connection
        if process is None or connection is None:
            return []
        self._closing = True
        self.request("end")
        events: list[dict[str, Any]] = []
        # Its events are read while it ends: a full pipe would block it.
        for _ in range(int(END_S / 0.05)):
            events += self._update(connection)
            process.join(0.05)
            if not process.is_alive():
                break
        else:
            process.terminate()
            process.join(2.0)
            if process.is_alive():
                process.kill()
                process.join()
        events += self._update(connection)
        self._release()
        return events

    def _update(self, connection: Connection) -> list[dict[str, Any]]:
        """Read the channels, and return the events that have come."""
        events: list[dict[str, Any]] = []
        try:
            while connection.poll():
                events.append(receive(connection))
        except (EOFError, OSError):
            pass
        if self._channels is not None:
            frame = self._channels.frames.read(self._read[0])
            if frame is not None:
                self._read[0], self.frame = frame
            status = self._channels.status.read(self._read[1])
            if status is not None:
                self._read[1], self.status = status
        return events

    def _release(self) -> None:
        if self._process is not None:
            self._process.join(1.0)
            self._process.close()
        if self._connection is not None:
            self._connection.close()
        self._process = self._connection = self._channels = None
