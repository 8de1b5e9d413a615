"""Keys from a plain terminal, and the terminal as it was afterwards, however the program ends."""

from __future__ import annotations

import atexit
import contextlib
import os
import select
import sys
from typing import Any

from layflat.app.support.errors import LayflatError

READ_BYTES = 4096
_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}
_SPECIAL = {
    **{f"\x1b{form}{letter}": name for form in "[O" for letter, name in _ARROWS.items()},
    **{f"\x1b[1;2{letter}": f"shift-{name}" for letter, name in _ARROWS.items()},
    "\r": "enter",
    "\n": "enter",
    " ": "space",
}


class TerminalKeys:
    """Each key as it is pressed, without Enter and without echo; Ctrl-C still interrupts."""

    def __init__(self) -> None:
        """LayflatError where standard input is no terminal."""
        try:
            import termios
            import tty
        except ImportError as error:
            raise LayflatError(
                "this system's terminals cannot be read key by key; use the window, or a gamepad"
            ) from error
        self._termios: Any = termios
        self._fd = -1
        self.gone = False
        """The terminal has been closed."""
        if not sys.stdin or not sys.stdin.isatty():
            raise LayflatError(
                "the keys of a terminal are needed, and standard input is none; run it in a terminal, or use"
                " --source gamepad or scripted"
            )
        self._fd = sys.stdin.fileno()
        self._before = termios.tcgetattr(self._fd)
        atexit.register(self.close)
        tty.setcbreak(self._fd, termios.TCSANOW)

    def pressed(self) -> list[str]:
        """Keys since the last call, in order, by their names; never waits."""
        if self._fd < 0 or self.gone or not select.select([self._fd], [], [], 0)[0]:
            return []
        try:
            text = os.read(self._fd, READ_BYTES)
        except OSError:
            text = b""
        self.gone = not text
        return names_of(text.decode("utf-8", "ignore"))

    def close(self) -> None:
        """The terminal as it was; what was typed ahead is thrown away, or the shell would take it for commands."""
        if self._fd < 0:
            return
        with contextlib.suppress(self._termios.error, OSError):  # It may be closed by now.
            self._termios.tcsetattr(self._fd, self._termios.TCSAFLUSH, self._before)
        self._fd = -1
        atexit.unregister(self.close)


def names_of(text: str) -> list[str]:
    """The keys behind what a terminal has sent; unknown sequences are none."""
    names = []
    while text:
        special = next((code for code in _SPECIAL if text.startswith(code)), None)
        if special is not None:
            names.append(_SPECIAL[special])
            text = text[len(special) :]
        elif text[0] == "\x1b":
            text = text[_sequence_length(text) :]
        else:
            names += [text[0]] if text[0].isprintable() else []
            text = text[1:]
    return names


def _sequence_length(text: str) -> int:
    """Characters of the escape sequence that ``text`` begins with."""
    if len(text) < 2 or text[1] not in "[O":
        return 1
    for length, character in enumerate(text[2:], start=3):
        if "@" <= character <= "~":
            return length
    return len(text)
