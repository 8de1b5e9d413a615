"""Process beside the window: serves one activity, such as recording or placing, until it is asked to end."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.context import BaseContext
from typing import Any, Protocol, TypeAlias

import cv2

from layflat.app.support.errors import format_error
from layflat.app.workstation.session.frame_channel import FrameChannel
from layflat.app.workstation.session.input_channel import InputChannel, InputSample
from layflat.app.workstation.session.latest_value import LatestJson
from layflat.app.workstation.session.requests import ActivityRequest

IDLE_S = 0.005
STATUS_S = 0.1
"""Longest time between two looks at the status, for its numbers."""
STATUS_BYTES = 32_000

Message: TypeAlias = Mapping[str, Any]
"""JSON values by name: a request of the window by ``request``, or an event of the activity by ``event``."""


class Channels:
    """Everything between the window and an activity's process that only matters in its newest state."""

    def __init__(self, context: BaseContext) -> None:
        self.frames = FrameChannel(context)
        self.inputs = InputChannel(context)
        self.status = LatestJson(context, STATUS_BYTES)


@dataclass(frozen=True, kw_only=True)
class Endpoint:
    """The process's end of the channels."""

    channels: Channels
    connection: Connection

    def latest_input(self) -> InputSample | None:
        """Return the newest input of the person."""
        return self.channels.inputs.read()

    def send_event(self, event: str, **values: Any) -> None:
        """Send something that must arrive: ``saved``, ``discarded``, ``line``, ``failed``, ``ended``."""
        send(self.connection, {"event": event, **values})


class Activity(Protocol):
    """Work of a process for one request of the window."""

    @property
    def done(self) -> bool:
        """Whether nothing more will be done."""

    def handle_request(self, request: Message) -> None:
        """Handle a request that came in between."""

    def step(self) -> float:
        """Do what is due; return for how many seconds nothing will be, 0 to be called again at once."""

    def status(self) -> dict[str, Any]:
        """Return the state, as JSON values."""

    def close(self) -> None:
        """End it now and save its results durably; may be called twice."""


ActivityFactory: TypeAlias = Callable[[ActivityRequest, Endpoint], Activity]


def send(connection: Connection, message: Message) -> None:
    """Send a message as JSON."""
    connection.send_bytes(json.dumps(message).encode())


def receive(connection: Connection) -> dict[str, Any]:
    """Return the next message; EOFError where the other end is closed."""
    message: dict[str, Any] = json.loads(connection.recv_bytes())
    return message


def main(make: ActivityFactory, request: ActivityRequest, channels: Channels, connection: Connection) -> None:
    """Serve one activity in this process."""
    configure_process()
    endpoint = Endpoint(channels=channels, connection=connection)
    activity: Activity | None = None
    try:
        activity = make(request, endpoint)
        _serve(activity, endpoint)
    except (EOFError, BrokenPipeError, Terminated):
        pass  # The window has ended, or ends this process.
    except Exception as error:
        _report(endpoint, error)
    finally:
        if activity is not None:
            _close(activity, endpoint)
        connection.close()


def _serve(activity: Activity, endpoint: Endpoint) -> None:
    written_s = 0.0
    while not activity.done:
        while endpoint.connection.poll():
            request = receive(endpoint.connection)
            if request["request"] == "end":
                return
            activity.handle_request(request)
        pause_s = activity.step()
        now = time.monotonic()
        if now - written_s >= STATUS_S or pause_s == 0.0:
            endpoint.channels.status.write(activity.status())
            written_s = now
        if pause_s > 0:
            endpoint.connection.poll(min(pause_s, IDLE_S))


def _close(activity: Activity, endpoint: Endpoint) -> None:
    """Save the results, and report it where that fails."""
    try:
        activity.close()
    except Exception as error:
        _report(endpoint, error)
    endpoint.channels.status.write(activity.status())
    with contextlib.suppress(OSError):
        endpoint.send_event("ended")


def _report(endpoint: Endpoint, error: Exception) -> None:
    with contextlib.suppress(OSError):  # The window may have ended.
        endpoint.send_event("failed", problem=format_error(error)[0])


class Terminated(BaseException):
    """SIGTERM."""


def configure_process() -> None:
    """Leave Ctrl-C to the window, which then ends this process; end on SIGTERM with everything saved.

    A window that is killed must not end this process either: it notices the closed connection and saves.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def terminate(_: int, __: object) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        raise Terminated

    signal.signal(signal.SIGTERM, terminate)
    # Output of libraries must not get into the stdout of the window's terminal.
    sys.stdout = sys.stderr
    os.environ["OMP_NUM_THREADS"] = "1"
    cv2.setNumThreads(1)
