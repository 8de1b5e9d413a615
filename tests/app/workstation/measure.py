"""Delay from a stick to the motion, and what a window sends over the network.

python -m layflat.tests.app.workstation.measure FOLDER 2     (runs of each; 15 pushes a run)

The stick is one of SDL's virtual pads. It is pushed at random moments; a push has acted when the first step that used
an input read after it begins, and the step's picture has come when it ends. The traffic is counted between the window
and an X server without shared memory, which is what `ssh -X` gives.
"""

from __future__ import annotations

import io
import os
import random
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from layflat.app.workers.sim_options import sim_config
from layflat.app.workstation.session.client import SessionClient
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.teleop.gamepad import Gamepad
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.app.workstation.terminal.display import TerminalDisplay, run_recording
from layflat.app.workstation.window import window as live
from layflat.app.workstation.window.launch import X_PORT
from layflat.tests.app.workstation.person import Person, headless, unplug_all
from layflat.tests.app.workstation.x_display import Display, Recorder, x_display
from layflat.tests.virtual_pad import VirtualPad

PUSHES = 15
OPTIONS = ("--source", "keyboard", "--robot", "hanger", "--episodes", "1")


class Pushes:
    """Pushes a stick at random moments; `look` is called again and again and compares the newest frame."""

    def __init__(self, client: SessionClient, pad: VirtualPad, seed: int) -> None:
        self.begins_ms: list[float] = []
        self.ends_ms: list[float] = []
        self._client, self._pad, self._random = client, pad, random.Random(seed)
        self._pushed_s: float | None = None
        self._timer: threading.Timer | None = None
        self._value = 0.3

    @property
    def done(self) -> bool:
        """Whether there are enough."""
        return len(self.ends_ms) >= PUSHES

    def look(self) -> None:
        """Push when it is time; note a push that has acted."""
        status, frame = self._client.status, self._client.frame
        if status.state == "waiting" and status.ready:
            self._client.send_command(Command.START)
        elif status.state in ("still", "running") and self._timer is None and not self.done:
            self._timer = threading.Timer(self._random.uniform(0.3, 0.6), self._push)
            self._timer.start()
        elif self._pushed_s is not None and frame is not None and frame.input_s >= self._pushed_s:
            self.ends_ms.append(1000 * (frame.published_s - self._pushed_s))
            self.begins_ms.append(self.ends_ms[-1] - 1000 * frame.work_s)
            self._pushed_s = self._timer = None

    def _push(self) -> None:
        self._value = -self._value
        now = time.monotonic()
        self._pad.axis("left_x", self._value)
        self._pushed_s = now


def request(folder: Path, name: str) -> SessionRequest:
    """Return a recording in real time."""
    return SessionRequest(
        sim_config=sim_config(robot="hanger", cloth="towel"), source="gamepad", session=folder / f"{name}.h5", seed=0,
        countdown_s=0.3,
    )  # fmt: skip


def in_window(folder: Path, seed: int) -> Pushes:
    """Push a stick while the window runs at its own rate."""
    person = Person(live.Window(request(folder, f"window-{seed}"), on_event=lambda _: None))
    pushes = Pushes(person.window.client, person.plug_in(), seed)
    while not pushes.done:
        person.look()
        pushes.look()
    person.window.close()
    unplug_all()
    return pushes


def in_terminal(folder: Path, seed: int) -> Pushes:
    """Push a stick while a terminal runs."""
    client, pad = SessionClient(), VirtualPad()
    asked = request(folder, f"terminal-{seed}")
    gamepad = Gamepad(asked.sim_config.robot_spec)
    gamepad.poll()
    pushes = Pushes(client, pad, seed)

    def sleep(seconds: float) -> None:
        time.sleep(seconds)
        pushes.look()

    client.start(asked)
    run_recording(client, gamepad, TerminalDisplay(io.StringIO()), stopped=lambda: pushes.done, sleep=sleep)
    gamepad.close()
    pad.unplug()
    return pushes


@contextmanager
def counted(display: Display) -> Iterator[tuple[Display, Callable[[], int]]]:
    """``with counted(display) as (through, sent)``: a display by TCP; ``sent()`` are the bytes of its programs."""
    sent = [0]
    server = socket.create_server(("127.0.0.1", 0))
    number = server.getsockname()[1] - X_PORT

    def pump(source: socket.socket, sink: socket.socket, counts: bool) -> None:
        with suppress(OSError):
            while data := source.recv(1 << 20):
                sent[0] += len(data) if counts else 0
                sink.sendall(data)
            sink.shutdown(socket.SHUT_RDWR)

    def accept() -> None:
        with suppress(OSError):
            while True:
                program, there = server.accept()[0], socket.socket(socket.AF_UNIX)
                there.connect(f"/tmp/.X11-unix/X{display.name[1:]}")
                for ends in ((program, there, True), (there, program, False)):
                    threading.Thread(target=pump, args=ends, daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()
    with server:
        yield Display(f"localhost:{number}", managed=display.managed), lambda: sent[0]


def traffic(folder: Path, size: str = "1288x804") -> dict[str, float]:
    """Return MB/s that the window sends while it waits, records, and while the view is turned, too."""
    found = {}
    with x_display(size, shared_memory=False) as display, counted(display) as (through, sent):
        recorder = Recorder(through, folder, *OPTIONS)

        def rate(seconds: float = 6.0) -> float:
            began, before = time.monotonic(), sent()
            time.sleep(seconds)
            return (sent() - before) / (time.monotonic() - began) / 1e6

        try:
            recorder.go("waiting")
            time.sleep(2.0)
            found["waiting"] = rate()
            recorder.display = display
            display.key("Return")
            time.sleep(4.0)
            display.xdotool("keydown", "Down", "sleep", "1")
            found["recording"] = rate()
            turn = threading.Thread(target=_turn, args=(display,))
            turn.start()
            found["recording, view turned"] = rate()
            turn.join()
        finally:
            display.xdotool("keyup", "Down", "key", "Escape")
            recorder.ended()
    return found


def _turn(display: Display) -> None:
    moves = [word for k in range(260) for word in ("mousemove_relative", "--", (3, -3)[k // 20 % 2], 0, "sleep", 0.02)]
    display.xdotool("mousemove", 300, 500, "mousedown", 1, *moves, "mouseup", 1)


def describe(name: str, values: list[float]) -> str:
    """Return median, 5 and 95 % and the largest."""
    low, middle, high = np.percentile(values, (5, 50, 95))
    return f"{name}: {middle:.0f} ms ({low:.0f} to {high:.0f}, largest {max(values):.0f}, n {len(values)})"


def main(folder: Path, runs: int) -> None:
    """Print everything; ``folder`` gets the recordings."""
    folder.mkdir(parents=True, exist_ok=True)
    os.environ["XDG_CONFIG_HOME"] = str(folder / "config")
    headless()
    for name, measure in (("window", in_window), ("terminal", in_terminal)):
        made = [measure(folder, seed) for seed in range(runs)]
        print(f"{name}, load {os.getloadavg()[0]:.1f}")
        print(describe("  from a push to the begin of its step", [v for one in made for v in one.begins_ms]))
        print(describe("  from a push to the end of its step", [v for one in made for v in one.ends_ms]), flush=True)
    for k in range(runs):
        at = Path(tempfile.mkdtemp(dir=folder))
        rates = {name: f"{rate:.2f} MB/s" for name, rate in traffic(at).items()}
        print(f"without shared memory, run {k}, load {os.getloadavg()[0]:.1f}: {rates}", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
