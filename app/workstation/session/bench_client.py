"""The window's end: starts a bench process, hears of it, and says in one sentence where it ended by itself."""

from __future__ import annotations

import json
import multiprocessing
from dataclasses import dataclass, field
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

from layflat.app.workstation.session.bench_process import Channels, Request, TaskFactory, main, receive, send
from layflat.app.workstation.session.frame_channel import BenchFrame
from layflat.app.workstation.teleop import TeleopInput
from layflat.data.robot import RobotSpec
from layflat.data.types import DragTarget

END_S = 20.0
"""Time for a bench process to put what it has on disk when it is told to end; assembling a large session takes some."""
PRELOAD = ["layflat.app.workstation.session.tasks"]


def bench_context() -> Any:
    """Fresh processes that have never stepped a simulation, forked from one that has imported everything."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOAD)
    return context


def warm() -> None:
    """Start that process now: it imports for a second or two while the person looks around."""
    bench_context()
    forkserver.ensure_running()


@dataclass
class BenchClient:
    """One bench process at most; another order ends the one before."""

    make: TaskFactory
    context: Any = field(default_factory=bench_context)
    sentence: str = ""
    """Why the last one ended by itself; empty where it was told to, or did what it was to do."""
    status: dict[str, Any] = field(default_factory=dict)
    """How the work stands, as it last said."""
    moment: BenchFrame | None = None
    _process: BaseProcess | None = None
    _connection: Connection | None = None
    _channels: Channels | None = None
    _seen: list[int] = field(default_factory=lambda: [0, 0])
    """Numbers of the newest moment and status that were read."""
    _closing: bool = False
    _done: bool = False
    """It has said that it ends, or why it failed."""

    def start(self, order: Request, robot: RobotSpec) -> None:
        """Begin a bench process for this order; returns at once."""
        self.end()
        self.sentence, self.status, self._seen, self._closing = "", {}, [0, 0], False
        self._done = False
        self._channels = Channels(self.context, robot)
        self._connection, theirs = self.context.Pipe()
        self._process = self.context.Process(
            target=main, args=(self.make, dict(order), self._channels, theirs), name="bench", daemon=False
        )
        self._process.start()
        theirs.close()

    @property
    def alive(self) -> bool:
        return self._process is not None

    @property
    def pid(self) -> int | None:
        return None if self._process is None else self._process.pid

    def ask(self, do: str, **values: Any) -> None:
        """Something for the work to obey; nothing where there is none any more."""
        if self._connection is None:
            return
        try:
            send(self._connection, {"do": do, **values})
        except OSError:
            return  # It is gone; ``hear`` will say so.

    def put(self, reading: TeleopInput, pull: DragTarget | None = None) -> float:
        """What the hands do now; returns the stamp."""
        return 0.0 if self._channels is None else self._channels.mailbox.put(reading, pull)

    def hear(self) -> list[dict[str, Any]]:
        """Read what is new: messages are returned, ``moment`` and ``status`` kept; notices where the process ended."""
        messages: list[dict[str, Any]] = []
        process, connection, channels = self._process, self._connection, self._channels
        if process is None or connection is None or channels is None:
            return messages
        ended = not process.is_alive()
        messages += _drained(connection)
        self._read(channels)
        failed = [m["sentence"] for m in messages if m["kind"] == "failed"]
        if failed:
            self.sentence = failed[-1]
        self._done = self._done or bool(failed) or any(m["kind"] == "ended" for m in messages)
        if ended:
            if not (self._closing or self._done):
                self.sentence = (
                    f"the bench ended by itself ({_how(process)}); what was kept is safe, and a running episode's"
                    " steps are kept as partial when it starts again"
                )
            self._forget()
        return messages

    def _read(self, channels: Channels) -> None:
        moment = channels.moments.read(self._seen[0])
        if moment is not None:
            self._seen[0], self.moment = moment
        told = channels.status.read(self._seen[1])
        if told is not None:
            self._seen[1] = told[0]
            self.status = json.loads(bytes(told[1]["text"]))

    def end(self) -> list[dict[str, Any]]:
        """Tell it to end, and wait until everything is on disk; returns its last messages."""
        process, connection = self._process, self._connection
        if process is None or connection is None:
            return []
        self._closing = True
        self.ask("end")
        messages: list[dict[str, Any]] = []
        process.join(0.0)
        # Its messages are taken while it ends: a full pipe would keep it from that.
        for _ in range(int(END_S / 0.05)):
            messages += _drained(connection)
            process.join(0.05)
            if not process.is_alive():
                break
        else:
            process.terminate()
            process.join(2.0)
            if process.is_alive():
                process.kill()
                process.join()
        messages += _drained(connection)
        if self._channels is not None:
            self._read(self._channels)
        self._forget()
        return messages

    def _forget(self) -> None:
        if self._process is not None:
            self._process.join(1.0)
            self._process.close()
        if self._connection is not None:
            self._connection.close()
        self._process = self._connection = self._channels = None


def _drained(connection: Connection) -> list[dict[str, Any]]:
    messages: list[dict[str, Any]] = []
    try:
        while connection.poll():
            messages.append(receive(connection))
    except (EOFError, OSError):
        pass
    return messages


def _how(process: BaseProcess) -> str:
    code = process.exitcode or 0
    return f"signal {-code}" if code < 0 else f"status {code}"
