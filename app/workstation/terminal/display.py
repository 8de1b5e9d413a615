"""Recording without a window: the cloth in characters, and keys or a gamepad; works over SSH."""

from __future__ import annotations

import math
import os
import select
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TextIO

from layflat.app.workstation.session.client import SessionClient
from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.session.status import Message, SessionStatus
from layflat.app.workstation.teleop.contact_rumble import ContactRumble
from layflat.app.workstation.teleop.teleop_input import TeleopInput
from layflat.app.workstation.teleop.teleoperator import Button, Teleoperator
from layflat.app.workstation.terminal.panel import panel

POLL_S = 0.01
"""Time between two polls of the teleoperator."""
SHOW_S = 0.1
FULL_SIZE = (80, 24)
"""Columns and rows of a terminal that does not know its own, such as a serial line."""


class TerminalDisplay:
    """Lines that are redrawn at the foot of a terminal, and lines that stay; without one, only new messages."""

    def __init__(
        self, stream: TextIO, buttons: Sequence[Button] = (), *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """``buttons`` are those of the device."""
        self._stream = stream
        self._buttons = buttons
        self._clock = clock
        self.live = stream.isatty() and os.environ.get("TERM") != "dumb"
        self._plain = not _can_write(stream, "⣿▼─█")
        self._shown_s = -math.inf
        self._message = ""
        self._height = 0
        """Number of lines that are drawn at the foot."""
        self._lines: list[str] = []
        self._size = (0, 0)
        self._kept: deque[str] = deque(maxlen=200)
        """Newest lines that stay."""

    def print_line(self, text: str, stream: TextIO | None = None) -> None:
        """Print a line that stays."""
        self.clear()
        if stream is None or stream.isatty():
            self._kept.append(text)
        print(text, file=stream or self._stream, flush=True)

    def show(self, status: SessionStatus, teleop: TeleopInput, frame: SimulationFrame | None = None) -> None:
        """Redraw the lines at the foot."""
        self.print_message(status.message)
        now = self._clock()
        if self.live and now - self._shown_s >= SHOW_S and select.select([], [self._stream], [], 0)[1]:
            self._shown_s = now
            self._follow_size()
            columns, rows = self._size
            lines = panel(status, teleop, self._buttons, frame, columns=columns, rows=rows, plain=self._plain)
            if self._height and lines == self._lines:
                return
            up = f"\x1b[{self._height - 1}A" if self._height > 1 else ""
            text = "\n".join(f"\r{line}\x1b[K" for line in lines)
            self._stream.write(f"{up}{text}\x1b[J")
            self._stream.flush()
            self._lines, self._height = lines, len(lines)

    def _columns_rows(self) -> tuple[int, int]:
        """Return the terminal's size now; COLUMNS may be that of another moment, and stdout may be a file."""
        with suppress(OSError):
            columns, rows = os.get_terminal_size(self._stream.fileno())
            return columns or FULL_SIZE[0], rows or FULL_SIZE[1]
        return FULL_SIZE

    def _follow_size(self) -> None:
        """After a change of size, which may have moved every line, clear the screen and print the newest again."""
        before, self._size = self._size, self._columns_rows()
        if self._height and self._size != before:
            newest = list(self._kept)[-max(self._size[1] - 1, 1) :]
            self._stream.write("\x1b[H\x1b[2J" + "".join(f"{line}\n" for line in newest))
            self._height = 0

    def print_message(self, message: Message) -> None:
        """Print a message where it is new."""
        if message.text != self._message:
            self._message = message.text
            if message.text:
                self.print_line(message.text)

    def print_result(self, line: str) -> None:
        """Print a line for scripts on stdout."""
        self.print_line(line, sys.stdout)

    def clear(self) -> None:
        """Remove the lines at the foot, for a line here or on stdout."""
        self._follow_size()
        if self._height:
            up = f"\x1b[{self._height - 1}A" if self._height > 1 else ""
            self._stream.write(f"{up}\r\x1b[J")
            self._stream.flush()
            self._height = 0


def _can_write(stream: TextIO, text: str) -> bool:
    """Return whether a stream's encoding has these characters."""
    try:
        text.encode(getattr(stream, "encoding", None) or "ascii")
    except (UnicodeError, LookupError):
        return False
    return True


def print_instructions(teleoperator: Teleoperator, print_line: Callable[[str], None]) -> None:
    """Print the effect of each button."""
    buttons = teleoperator.help()
    width = max(len(button.name) for button in buttons)
    for button in buttons:
        print_line(f"  {button.name:{width}}  {button.text}")


def run_recording(
    client: SessionClient,
    teleoperator: Teleoperator,
    display: TerminalDisplay,
    *,
    stopped: Callable[[], bool],
    sleep: Callable[[float], None] = time.sleep,
) -> None:
    """Pass a person's input to a session until it is over or ``stopped`` returns True, with everything saved."""
    rumble = ContactRumble(teleoperator)
    while client.alive and not stopped():
        teleop = teleoperator.poll()
        for command in teleop.commands:
            client.send_command(command)
        client.send_input(teleop)
        for event in client.poll():
            display.print_result(event.text)
        rumble.update(client.status.contact, client.status.steps)
        display.show(client.status, teleop, client.frame)
        # A device that was away for one poll only must be noticed, too.
        sleep(POLL_S if teleop.connected else 10 * POLL_S)
    for event in client.end():
        display.print_result(event.text)
    display.clear()
