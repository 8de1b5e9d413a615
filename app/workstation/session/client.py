"""SessionClient: the end of a session that a window, a terminal or a browser holds."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from typing import Any

from layflat.app.support.errors import LayflatError
from layflat.app.workstation.session.activities import make_activity
from layflat.app.workstation.session.activity_client import ActivityClient
from layflat.app.workstation.session.control_token import ControlToken
from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.session.requests import PlaceRequest, RecordRequest
from layflat.app.workstation.session.status import SessionEvent, SessionStatus
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput
from layflat.data.robot import RobotSpec
from layflat.data.types import DragTarget


@dataclass
class SessionClient:
    """At most one session at a time, in a process of its own; may be used from several threads.

    Several viewers may show one client; of those only the one in `control` changes anything. The name of a viewer is
    free; a program with one viewer leaves it out.
    """

    status: SessionStatus = field(default_factory=SessionStatus)
    """Newest status."""
    frame: SimulationFrame | None = None
    """Newest frame of the simulation."""
    robot: RobotSpec | None = None
    """Robot of the newest request."""
    request: SessionRequest | None = None
    """Newest request."""
    problem: str = ""
    """Why the last session ended by itself; empty where it was asked to, or was done."""
    control: ControlToken = field(default_factory=ControlToken)
    _client: ActivityClient = field(default_factory=lambda: ActivityClient(make_activity))
    _lock: threading.RLock = field(default_factory=threading.RLock)

    def start(self, request: SessionRequest) -> None:
        """Start a session, and end the one before; return at once."""
        with self._lock:
            self.end()
            self.request, self.robot, self.problem = request, request.sim_config.robot_spec, ""
            self.status, self.frame = _first_status(request), None
            common: dict[str, Any] = {
                "sim_config": request.sim_config,
                "seed": request.seed or 0,
                "speed": request.speed,
                "images": request.images,
                "source": request.source,
                "session": request.session,
            }
            if request.policy is None:
                self._client.start(
                    RecordRequest(
                        **common,
                        countdown_s=request.countdown_s,
                        episodes=request.episodes,
                        disturbance=request.disturbance,
                    )
                )
            else:
                self._client.start(PlaceRequest(**common, policy=request.policy, fast_forward=request.fast_forward))
                self._client.request("start")

    @property
    def alive(self) -> bool:
        """Whether there is a session."""
        return self._client.alive

    @property
    def pid(self) -> int | None:
        """Number of the session's process."""
        return self._client.pid

    def send_command(self, command: Command, viewer: str = "") -> bool:
        """Send a command; return False where another viewer is in control."""
        return self._send(viewer, "command", name=command.name)

    def disturb(self, name: str, viewer: str = "") -> bool:
        """Start a named disturbance; return False where another viewer is in control."""
        return self._send(viewer, "disturb", name=name)

    def answer(self, yes: bool, viewer: str = "") -> bool:
        """Answer the question of the status; return False where another viewer is in control."""
        return self._send(viewer, "answer", yes=yes)

    def undo(self, viewer: str = "") -> bool:
        """Bring the discarded take back; return False where another viewer is in control."""
        return False

    def send_input(self, teleop: TeleopInput, drag: DragTarget | None = None, viewer: str = "") -> float:
        """Replace the newest input; return its stamp, or 0 where another viewer is in control."""
        with self._lock:
            return self._client.send_input(teleop, drag) if self.control.take(viewer) else 0.0

    def poll(self) -> list[SessionEvent]:
        """Update `status` and `frame`, and notice where the session has ended; return what must be shown once."""
        with self._lock:
            events = self._client.poll_events()
            self._update()
            return _events(events)

    def end(self) -> list[SessionEvent]:
        """End the session and wait until everything is durable; return its last events."""
        with self._lock:
            events = self._client.end()
            self._update()
            return _events(events)

    def check(self) -> None:
        """Raise a LayflatError where the session ended by itself."""
        if self.problem:
            raise LayflatError(self.problem)

    def _send(self, viewer: str, request: str, **values: Any) -> bool:
        with self._lock:
            if not self.control.take(viewer):
                return False
            self._client.request(request, **values)
            return True

    def _update(self) -> None:
        self.problem, self.frame = self._client.problem, self._client.frame
        if self.request is not None and self._client.status:
            self.status = _status(self.request, self._client.status)


def _first_status(request: SessionRequest) -> SessionStatus:
    return SessionStatus(
        mode=request.mode,
        task=request.sim_config.task,
        source=request.source,
        recording=request.session is not None,
        seed=request.seed or 0,
        target=request.episodes,
        message=request.note,
    )


def _status(request: SessionRequest, values: dict[str, Any]) -> SessionStatus:
    states = {"ready": "waiting", "placing": "running", "disturbing": "running", "repairing": "running"}
    phases = {"disturbing": "disturb", "repairing": "repair"}
    state = str(values["state"])
    shown = "paused" if values.get("paused") else states.get(state, "stopped" if state == "placed" else state)
    if state == "running" and values.get("waiting_for_motion"):
        shown = "still"
    effects = {name: text for name, text in values.get("effects", {}).items() if text is not None}
    first = _first_status(request).to_json()
    return SessionStatus.from_json(
        first
        | values
        | {
            "state": shown,
            "phase": phases.get(state, "place"),
            "ready": bool(values.get("ready", True)),
            "countdown_s": values.get("countdown", 0.0),
            "effects": effects,
            "can_disturb": request.policy is not None and state not in ("ready", "over"),
            "can_drag": shown in ("still", "running", "stopped"),
            "recording": request.session is not None,
            "message": {"text": values["message"]},
        }
    )


def _events(events: list[dict[str, Any]]) -> list[SessionEvent]:
    lines = [str(event["line"]) for event in events if "line" in event]
    return [
        SessionEvent(kind="kept" if line.startswith("kept") else "discarded", text=line, level="success")
        for line in lines
    ]
