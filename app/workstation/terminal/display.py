"""Recording without a window: a status line, keys or a pad, and nothing that SSH does not carry."""

from __future__ import annotations

import math
import os
import shutil
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TextIO

from layflat.app.workstation.session.rate_limiter import RateLimiter
from layflat.app.workstation.session.recording_session import RecordingSession
from layflat.app.workstation.teleop.contact_rumble import ContactRumble
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput
from layflat.app.workstation.teleop.teleoperator import Teleoperator

POLL_S = 0.01
"""How often the source is asked between two steps."""
SHOW_S = 0.1


class TerminalDisplay:
    """A line that is drawn over on a terminal, and lines that stay; without a terminal only what is new is printed."""

    def __init__(self, stream: TextIO, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream
        self._clock = clock
        self._live = stream.isatty()
        self._shown_s = -math.inf
        self._said = ""
        self._drawn = False

    def say(self, text: str) -> None:
        """A line that stays."""
        self.clear()
        print(text, file=self._stream, flush=True)

    def show(self, recording: RecordingSession, reading: TeleopInput) -> None:
        """How it stands now."""
        self.note(recording.message)
        now = self._clock()
        if self._live and now - self._shown_s >= SHOW_S:
            self._shown_s = now
            width = shutil.get_terminal_size().columns - 1
            self._stream.write(f"\r{status_line(recording, reading)[:width]}\x1b[K")
            self._stream.flush()
            self._drawn = True

    def note(self, message: str) -> None:
        """A line that stays, where it is new."""
        if message != self._said:
            self._said = message
            if message:
                self.say(message)

    def clear(self) -> None:
        """Make room for a line, here or on stdout."""
        if self._drawn:
            self._stream.write("\r\x1b[K")
            self._stream.flush()
            self._drawn = False


def status_line(recording: RecordingSession, reading: TeleopInput) -> str:
    """State, numbers and what can be done, for one line."""
    glance, state = recording.glance, recording.state
    said = {
        "waiting": f"seed {recording.seed} " + ("hangs" if recording.ready else "is being hung"),
        "countdown": f"begins in {recording.countdown_left_s():.0f}" if recording.ready else "hanging the cloth",
        "running": ("move to go on" if glance.n_steps else "move to begin") if recording.awaits_motion else "RECORDING",
    }.get(state, state)
    numbers = f"{glance.n_steps} steps  contact {100 * glance.contact_portion:.0f} %  speed {100 * reading.speed:.0f} %"
    doable = [(control, recording.does(control)) for control in Command]
    return f"[{said}]  {numbers}  " + ", ".join(control.value for control, does in doable if does)


def introduce(recording: RecordingSession, source: Teleoperator, say: Callable[[str], None]) -> None:
    """What the buttons do, before it begins."""
    width = max(len(button.name) for button in source.help())
    for button in source.help():
        say(f"  {button.name:{width}}  {button.does}")
    if recording.message:
        say(recording.message)


def run_recording(
    recording: RecordingSession,
    source: Teleoperator,
    screen: TerminalDisplay,
    *,
    step_s: float,
    stopped: Callable[[], bool],
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> RateLimiter:
    """Until it is over, or ``stopped`` says so. Returns how steadily the steps came.

    The source is asked right before each step: what the hands do then moves the cloth in this very step.
    """
    cadence = RateLimiter(step_s, memory=None, clock=clock, sleep=sleep)
    touch = ContactRumble(source)
    while recording.state != "over" and not stopped():
        reading = source.poll()
        recording.hear(reading)
        if not recording.simulates:
            recording.step()
            cadence.pause()
        elif cadence.left_s() == 0:
            cadence.begin()
            recording.step()
            cadence.end()
            touch.see(recording.glance.contact_portion, recording.glance.n_steps)
        screen.show(recording, reading)
        sleep(min(cadence.left_s() or POLL_S, POLL_S) if recording.simulates else POLL_S)
    screen.clear()
    return cadence


@contextmanager
def stops_on_signals() -> Iterator[Callable[[], bool]]:
    """Ctrl-C, SIGTERM and a closed terminal end the recording between two steps, with everything kept.

    Yields whether one has come; a second Ctrl-C interrupts at once.
    """
    came: list[int] = []

    def note(number: int, _: object) -> None:
        if number == signal.SIGINT and came:
            raise KeyboardInterrupt
        came.append(number)

    numbers = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP] if os.name == "posix" else [signal.SIGINT]
    before = {number: signal.signal(number, note) for number in numbers}
    try:
        yield lambda: bool(came)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def to_stdout(screen: TerminalDisplay) -> Callable[[str], None]:
    """Prints the contract's lines there, without the status line in between."""

    def tell(line: str) -> None:
        screen.clear()
        print(line, flush=True, file=sys.stdout)

    return tell
