"""Process of a session: holds the state machine and the only writer of the file until it is asked to end."""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict, replace
from multiprocessing.connection import Connection, wait
from multiprocessing.context import BaseContext
from typing import Any, TypeAlias

import cv2

from layflat.app.support.errors import format_error
from layflat.app.workstation.session.episode import EpisodeHandle
from layflat.app.workstation.session.episode_process import EpisodeConfig, EpisodeProcess
from layflat.app.workstation.session.frame_channel import FrameChannel
from layflat.app.workstation.session.input_channel import InputChannel
from layflat.app.workstation.session.latest_value import LatestJson
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.session.session import IDLE_S, Session
from layflat.app.workstation.session.session_queries import n_episodes, next_seeds, recorded_seeds, skipped_text
from layflat.app.workstation.session.status import Message as Note
from layflat.app.workstation.session.status import SessionEvent
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.data.session.recorder import SessionRecorder

STATUS_S = 0.03
"""Time between two looks at the status: a frame of a viewer."""
STATUS_BYTES = 32_000
STALE_S = 1.0
"""Age of an input from which on it moves nothing: its viewer hangs, or is stopped."""
SAVE_S = 18.0
"""Time for a process to make everything durable when it ends."""

Message: TypeAlias = Mapping[str, Any]
"""JSON values by name: a request of the client by ``request``, or an event of the session by ``event``."""


class Channels:
    """Everything between the client and the session's process that only matters in its newest state."""

    def __init__(self, context: BaseContext) -> None:
        self.frames = FrameChannel(context)
        self.inputs = InputChannel(context)
        self.status = LatestJson(context, STATUS_BYTES)


def send(connection: Connection, message: Message) -> None:
    """Send a message as JSON."""
    connection.send_bytes(json.dumps(message).encode())


def receive(connection: Connection) -> dict[str, Any]:
    """Return the next message; EOFError where the other end is closed."""
    message: dict[str, Any] = json.loads(connection.recv_bytes())
    return message


class SessionServer:
    """One session in this process, with its recorder, its episodes and the client's end."""

    def __init__(self, request: SessionRequest, channels: Channels, connection: Connection) -> None:
        self._request, self._channels, self._connection = request, channels, connection
        self._recorder: SessionRecorder | None = None
        self._session: Session | None = None
        self._episodes: list[EpisodeProcess] = []
        self._written_s = 0.0
        self._ends = False
        """Whether SIGTERM has come, or the client has gone."""

    def run(self) -> None:
        """Serve until the session is done; report an error to the client."""
        signal.signal(signal.SIGTERM, self._terminate)
        try:
            self._serve(self._open())
        except Exception as error:
            self._fail(error)
        finally:
            self._close()

    def _terminate(self, number: int, frame: object) -> None:
        self._ends = True

    def _open(self) -> Session:
        """Open the file, and start the session with the next seed that it does not hold."""
        request, used, seed = self._request, frozenset[int](), self._request.seed or 0
        self._recorder = request.open_recorder()
        recovered = () if self._recorder is None else self._recorder.recovered
        if request.session is not None and request.source:
            used = recorded_seeds(request.session, request.recorded_source)
            (seed,), skipped = next_seeds(request.session, request.recorded_source, 1, request.seed)
            if skipped and not (recovered or request.note.text):
                request = replace(request, note=Note(text=skipped_text(request.session, skipped, [seed])))
        self._session = Session(
            request,
            self._make_episode,
            seed=seed,
            used_seeds=used,
            n_episodes=0 if request.session is None else n_episodes(request.session),
            recovered=recovered,
            emit=self._emit,
        )
        return self._session

    def _make_episode(self, seed: int) -> EpisodeHandle:
        journal = None if self._recorder is None else self._recorder.new_journal()
        config = EpisodeConfig(request=self._request, seed=seed, journal=journal, frames=self._channels.frames)
        # This process never steps a simulation and has no threads, so its episodes may be forked.
        made = EpisodeProcess(config, self._recorder, multiprocessing.get_context("fork"))
        self._episodes = [episode for episode in self._episodes if not episode.connection.closed] + [made]
        return made

    def _serve(self, session: Session) -> None:
        while not session.done:
            self._handle_requests(session)
            if self._ends and session.state != "over":
                session.close()
            # Right before a step begins: the newest input acts in that very step.
            sample = self._channels.inputs.read()
            if sample is not None:
                fresh = time.monotonic() - sample.stamp_s < STALE_S
                still = replace(sample.teleop, motion=0 * sample.teleop.motion, hand=None)
                session.handle_input(sample.teleop if fresh else still, sample.drag if fresh else None)
            pause_s = session.update()
            self._write_status(session)
            connections = [episode.connection for episode in self._episodes if not episode.connection.closed]
            if pause_s > 0:
                wait([*connections, *([] if self._ends else [self._connection])], min(pause_s, IDLE_S))

    def _handle_requests(self, session: Session) -> None:
        try:
            while not self._ends and self._connection.poll():
                request = receive(self._connection)
                match request["request"]:
                    case "end":
                        self._ends = True
                    case "command":
                        session.handle_command(Command[str(request["name"])])
                    case "disturb":
                        session.disturb(str(request["name"]))
                    case "answer":
                        session.answer(bool(request["yes"]))
        except (EOFError, OSError):
            self._ends = True  # The client is gone: everything is saved.

    def _write_status(self, session: Session, *, now: bool = False) -> None:
        now_s = time.monotonic()
        if now or now_s - self._written_s >= STATUS_S:
            self._channels.status.write(session.status().to_json())
            self._written_s = now_s

    def _emit(self, event: SessionEvent) -> None:
        self._send("shown", **asdict(event))

    def _fail(self, error: BaseException) -> None:
        sentence, status = format_error(error)
        self._send("failed", problem=sentence, status=status)

    def _send(self, event: str, **values: Any) -> None:
        with contextlib.suppress(OSError):  # The client may have ended.
            send(self._connection, {"event": event, **values})

    def _close(self) -> None:
        """Make everything durable, and report it where that fails."""
        try:
            if self._session is not None:
                self._session.close()
                end_s = time.monotonic() + SAVE_S
                while not self._session.done and time.monotonic() < end_s:
                    time.sleep(self._session.update())
                self._write_status(self._session, now=True)
            for episode in self._episodes:
                episode.kill()
            if self._recorder is not None:
                self._recorder.close()
        except Exception as error:
            self._fail(error)
        self._send("ended")
        self._connection.close()


def main(request: SessionRequest, channels: Channels, connection: Connection) -> None:
    """Serve one session in this process.

    Ctrl-C and a closed terminal are the client's, which then ends this process. A client that is killed does not end
    it: it notices the closed connection and saves.
    """
    for number in (signal.SIGINT, *([signal.SIGHUP] if os.name == "posix" else [])):
        signal.signal(number, signal.SIG_IGN)
    # Output of libraries must not get into the stdout of the client's terminal.
    sys.stdout = sys.stderr
    os.environ["OMP_NUM_THREADS"] = "1"
    cv2.setNumThreads(1)
    SessionServer(request, channels, connection).run()
