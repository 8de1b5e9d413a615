"""Process of a session: holds the state machine and the only writer of the file until it is asked to end."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import time
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection, wait
from multiprocessing.context import BaseContext

import cv2

from layflat.app.support.errors import format_error
from layflat.app.workstation.session.episode import EpisodeHandle
from layflat.app.workstation.session.episode_process import EpisodeConfig, EpisodeProcess
from layflat.app.workstation.session.frame_channel import FRAME_BYTES, SimulationFrame
from layflat.app.workstation.session.latest_value import LatestValue
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.session.session import IDLE_S, Session
from layflat.app.workstation.session.session_queries import n_episodes, next_seeds, recorded_seeds, skipped_text
from layflat.app.workstation.session.status import Message, SessionStatus
from layflat.app.workstation.teleop.teleop_input import TeleopInput
from layflat.data.session.recorder import SessionRecorder
from layflat.data.types import DragTarget

STATUS_S = 0.03
"""Time between two looks at the status: a frame of a viewer."""
STALE_S = 2.0
"""Age of an input from which on it moves nothing: its viewer hangs, or is stopped."""
SAVE_S = 18.0
"""Time for a process to make everything durable when it ends."""


class Channels:
    """Everything between client and session that only matters in its newest state."""

    def __init__(self, context: BaseContext) -> None:
        self.frames: LatestValue[SimulationFrame] = LatestValue(context, FRAME_BYTES)
        self.inputs: LatestValue[tuple[TeleopInput, DragTarget | None]] = LatestValue(context, 16_000)
        self.status: LatestValue[SessionStatus] = LatestValue(context, 64_000)


@dataclass(frozen=True)
class Failure:
    """Error with which a session has ended by itself."""

    problem: str
    exit_status: int


class SessionServer:
    """One session in this process, with its recorder, its episodes and the client's end."""

    def __init__(self, request: SessionRequest, channels: Channels, connection: Connection) -> None:
        self._request, self._channels, self._connection = request, channels, connection
        self._recorder: SessionRecorder | None = None
        self._session: Session | None = None
        self._episodes: list[EpisodeProcess] = []
        self._shown, self._shown_s = SessionStatus(), 0.0
        self._ends = False
        """Whether it was asked to end, by SIGTERM too, or the client has gone."""

    def run(self) -> None:
        """Serve until the session is done; report an error to the client."""
        signal.signal(signal.SIGTERM, self._terminate)
        try:
            self._serve(self._open())
        except Exception as error:
            self._send(Failure(*format_error(error)))
        try:
            self._close()
        except Exception as error:
            self._send(Failure(*format_error(error)))
        self._send("ended")
        self._connection.close()

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
                request = replace(request, note=Message(text=skipped_text(request.session, skipped, [seed])))
        self._session = Session(
            request,
            self._make_episode,
            seed=seed,
            used_seeds=used,
            n_episodes=0 if request.session is None else n_episodes(request.session),
            recovered=recovered,
            emit=self._send,
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
            newest = self._channels.inputs.read()
            if newest is not None:
                teleop, drag = newest[1]
                if time.monotonic() - teleop.stamp_s > STALE_S:
                    teleop, drag = replace(teleop, motion=0 * teleop.motion, hand=None), None
                session.handle_input(teleop, drag)
            pause_s = session.update()
            if time.monotonic() - self._shown_s >= STATUS_S:
                self._show(session)
            if pause_s > 0:
                connections = [episode.connection for episode in self._episodes if not episode.connection.closed]
                wait([*connections, *([] if self._ends else [self._connection])], min(pause_s, IDLE_S))

    def _handle_requests(self, session: Session) -> None:
        try:
            while not self._ends and self._connection.poll():
                match self._connection.recv():
                    case ("command", command):
                        session.handle_command(command)
                    case ("disturb", name):
                        session.disturb(name)
                    case ("answer", yes):
                        session.answer(yes)
                    case _:
                        self._ends = True
        except (EOFError, OSError):
            self._ends = True  # The client is gone: everything is saved.

    def _show(self, session: Session) -> None:
        status, self._shown_s = session.status(), time.monotonic()
        if status != self._shown:
            self._shown = status
            self._channels.status.write(status)

    def _send(self, event: object) -> None:
        with contextlib.suppress(OSError):  # The client may have ended.
            self._connection.send(event)

    def _close(self) -> None:
        """Make everything durable."""
        if self._session is not None:
            self._session.close()
            end_s = time.monotonic() + SAVE_S
            while not self._session.done and time.monotonic() < end_s:
                time.sleep(self._session.update())
            self._show(self._session)
        for episode in self._episodes:
            episode.kill()
        if self._recorder is not None:
            self._recorder.close()


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
