"""Recording without a window: a status line, and keys or a gamepad; works over SSH."""

from __future__ import annotations

import math
import os
import select
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TextIO

from layflat.app.workstation.session.client import SessionClient
from layflat.app.workstation.session.status import Message, SessionStatus
from layflat.app.workstation.teleop.contact_rumble import ContactRumble
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput
from layflat.app.workstation.teleop.teleoperator import Teleoperator

POLL_S = 0.01
"""Time between two polls of the teleoperator."""
SHOW_S = 0.1
FULL_WIDTH = 80
"""Columns of a terminal that does not know its own, such as a serial line."""


class TerminalDisplay:
    """A status line that is redrawn on a terminal, and lines that stay; without a terminal, only new messages."""

    def __init__(self, stream: TextIO, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream
        self._clock = clock
        self._live = stream.isatty() and os.environ.get("TERM") != "dumb"
        self._shown_s = -math.inf
        self._message = ""
        self._drawn = False

    def print_line(self, text: str) -> None:
        """Print a line that stays."""
        self.clear()
        print(text, file=self._stream, flush=True)

    def show(self, status: SessionStatus, teleop: TeleopInput) -> None:
        """Redraw the status line."""
        self.print_message(status.message)
        now = self._clock()
        if self._live and now - self._shown_s >= SHOW_S and select.select([], [self._stream], [], 0)[1]:
            self._shown_s = now
            self._stream.write(f"\r{status_line(status, teleop)[: self._columns() - 1]}\x1b[K")
            self._stream.flush()
            self._drawn = True

    def _columns(self) -> int:
        """Return the terminal's width now; COLUMNS may be that of another moment, and stdout may be a file."""
        with suppress(OSError):
            return os.get_terminal_size(self._stream.fileno()).columns or FULL_WIDTH
        return FULL_WIDTH

    def print_message(self, message: Message) -> None:
        """Print a message where it is new."""
        if message.text != self._message:
            self._message = message.text
            if message.text:
                self.print_line(message.text)

    def print_result(self, line: str) -> None:
        """Print a line for scripts on stdout."""
        self.clear()
        print(line, flush=True, file=sys.stdout)

    def clear(self) -> None:
        """Remove the status line, for a line here or on stdout."""
        if self._drawn:
            self._stream.write("\r\x1b[K")
            self._stream.flush()
            self._drawn = False


def status_line(status: SessionStatus, teleop: TeleopInput) -> str:
    """Return state, numbers and available commands on one line."""
    texts = {
        "waiting": f"seed {status.seed} " + ("hangs" if status.ready else "is being hung"),
        "countdown": f"starts in {status.countdown_s:.0f}" if status.ready else "hanging the cloth",
        "still": "move to continue" if status.steps else "move to start",
        "running": "RECORDING",
    }
    numbers = f"{status.steps} steps  contact {100 * status.contact:.0f} %  speed {100 * teleop.speed:.0f} %"
    available = ", ".join(command.value for command in Command if status.effect(command))
    return f"[{texts.get(status.state, status.state)}]  {numbers}  {available}"


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
        display.show(client.status, teleop)
        # A device that was away for one poll only must be noticed, too.
        sleep(POLL_S if teleop.connected else 10 * POLL_S)
    for event in client.end():
        display.print_result(event.text)
    display.clear()
