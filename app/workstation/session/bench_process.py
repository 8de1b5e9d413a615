"""The bench's process: serves one order of the window, such as recording or placing, until told to end."""

from __future__ import annotations

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

import numpy as np

from layflat.app.support.errors import format_error
from layflat.app.workstation.session.frame_channel import FrameChannel
from layflat.app.workstation.session.input_channel import InputChannel, InputSample
from layflat.app.workstation.session.latest_value import LatestValue
from layflat.data.robot import RobotSpec

IDLE_S = 0.005
STATUS_S = 0.1
"""A status that nothing happens to is told so often, for its numbers."""
_STATUS_BYTES = 32_000

Request: TypeAlias = Mapping[str, Any]
"""What is to be done, or asked in between: JSON values by name."""


class Channels:
    """Everything between the window and one bench process. Bytes on the way are JSON or arrays, never code."""

    def __init__(self, context: BaseContext, robot: RobotSpec) -> None:
        self.moments = FrameChannel(context)
        self.mailbox = InputChannel(context, robot)
        self.status = LatestValue(context, np.dtype([("text", f"S{_STATUS_BYTES}")]))


@dataclass(frozen=True, kw_only=True)
class Endpoint:
    """A bench process's end of the channels."""

    channels: Channels
    connection: Connection

    def letter(self) -> InputSample | None:
        return self.channels.mailbox.look()

    def tell(self, kind: str, **values: Any) -> None:
        """Something that must arrive: ``kept``, ``said``, ``failed``."""
        send(self.connection, {"kind": kind, **values})


class BenchTask(Protocol):
    """What a bench process does for one order."""

    @property
    def over(self) -> bool:
        """Nothing more will be done."""

    def obey(self, order: Request) -> None:
        """Something that the window asks in between."""

    def advance(self) -> float:
        """Do what is due; returns for how many seconds nothing will be, 0 to be asked again at once."""

    def status(self) -> dict[str, Any]:
        """How it stands, as JSON values."""

    def close(self) -> None:
        """End it now, with everything that is to be kept on disk. May be called twice."""


TaskFactory: TypeAlias = Callable[[Request, Endpoint], BenchTask]


def send(connection: Connection, message: Request) -> None:
    connection.send_bytes(json.dumps(message).encode())


def receive(connection: Connection) -> dict[str, Any]:
    """The next message; EOFError where the other side is gone."""
    message: dict[str, Any] = json.loads(connection.recv_bytes())
    return message


def main(make: TaskFactory, order: Request, channels: Channels, connection: Connection) -> None:
    """The life of a bench process."""
    configure_process()
    desk = Endpoint(channels=channels, connection=connection)
    work: BenchTask | None = None
    try:
        work = make(order, desk)
        _serve(work, desk)
    except (EOFError, BrokenPipeError, Terminated):
        pass  # The window is gone, or wants this process gone.
    except Exception as error:
        sentence, _ = format_error(error)
        _try(lambda: desk.tell("failed", sentence=sentence))
    finally:
        if work is not None:
            _close(work, desk)
        connection.close()


def _serve(work: BenchTask, desk: Endpoint) -> None:
    told_s, told = 0.0, ""
    while not work.over:
        while desk.connection.poll():
            asked = receive(desk.connection)
            if asked.get("do") == "end":
                return
            work.obey(asked)
        pause_s = work.advance()
        now = time.monotonic()
        if now - told_s >= STATUS_S or pause_s == 0.0:
            text = json.dumps(work.status())
            if text != told:
                desk.channels.status.write(text=text.encode()[:_STATUS_BYTES])
                told = text
            told_s = now
        if pause_s > 0:
            desk.connection.poll(min(pause_s, IDLE_S))


def _close(work: BenchTask, desk: Endpoint) -> None:
    """Whatever is to be kept goes to the disk; what cannot be is said."""
    try:
        work.close()
    except Exception as error:
        sentence, _ = format_error(error)
        _try(lambda: desk.tell("failed", sentence=sentence))
    text = json.dumps(work.status())
    desk.channels.status.write(text=text.encode()[:_STATUS_BYTES])
    _try(lambda: desk.tell("ended"))


def _try(act: Callable[[], None]) -> None:
    """Say it, if there is anybody left to hear it."""
    try:
        act()
    except OSError:
        return


class Terminated(BaseException):
    """SIGTERM."""


def configure_process() -> None:
    """Ctrl-C is the window's to deal with, which then ends this process; SIGTERM ends it with everything kept."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def ended(_: int, __: object) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        raise Terminated

    signal.signal(signal.SIGTERM, ended)
    # What a library prints has no place in the terminal that the window was opened from.
    sys.stdout = sys.stderr
    os.environ["OMP_NUM_THREADS"] = "1"
    import cv2

    cv2.setNumThreads(1)
