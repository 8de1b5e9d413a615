"""Keys of a plain terminal, which is restored however the program ends."""

from __future__ import annotations

import atexit
import contextlib
import os
import select
import signal
import sys
import threading
from typing import Any

from layflat.app.support.errors import LayflatError

READ_BYTES = 4096
_INPUT, _LOCAL, _CHARACTERS = 0, 3, 6
"""Places in what termios.tcgetattr returns."""
_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}
_SPECIAL = {
    **{f"\x1b{form}{letter}": name for form in "[O" for letter, name in _ARROWS.items()},
    **{f"\x1b[1;2{letter}": f"shift-{name}" for letter, name in _ARROWS.items()},
    "\r": "enter",
    "\n": "enter",
    " ": "space",
}


class TerminalKeys:
    """Terminal that returns each key as it is pressed, without Enter and echo; Ctrl-C still interrupts."""

    def __init__(self) -> None:
        """Change the terminal's mode; LayflatError where standard input is not a terminal."""
        try:
            import termios
        except ImportError as error:
            raise LayflatError(
                "this system's terminals cannot be read key by key; use the window, or a gamepad"
            ) from error
        self._termios: Any = termios
        self._fd = -1
        self.gone = False
        """Whether the terminal was closed."""
        if not sys.stdin or not sys.stdin.isatty():
            raise LayflatError(
                "standard input is not a terminal, so no keys can be read; run it in a terminal, or use"
                " --source gamepad or scripted"
            )
        self._fd = sys.stdin.fileno()
        self.resumed = False
        """Whether the program was stopped (Ctrl-Z) and continues; for the reader to reset."""
        self._before = termios.tcgetattr(self._fd)
        self._while_stopped: dict[int, Any] = {}
        atexit.register(self.close)
        self._take_over()
        if threading.current_thread() is threading.main_thread():
            for number, handle in ((signal.SIGTSTP, self._stop), (signal.SIGCONT, self._continue)):
                self._while_stopped[number] = signal.signal(number, handle)

    def pressed(self) -> list[str]:
        """Return the names of the keys since the last call, in order; never wait."""
        if self._fd < 0 or self.gone or not select.select([self._fd], [], [], 0)[0]:
            return []
        try:
            text = os.read(self._fd, READ_BYTES)
        except OSError:
            text = b""
        self.gone = not text
        return key_names(text.decode("utf-8", "ignore"))

    def close(self) -> None:
        """Restore the terminal and drop what was typed ahead: the shell would take it for commands."""
        if self._fd < 0:
            return
        for number, handler in self._while_stopped.items():
            signal.signal(number, handler)
        self._restore()
        self._fd = -1
        atexit.unregister(self.close)

    def _take_over(self) -> None:
        """Read key by key, without echo; Ctrl-S would freeze the display, SIGQUIT leave the terminal so."""
        mode = list(self._before)
        mode[_INPUT] &= ~self._termios.IXON
        mode[_LOCAL] &= ~(self._termios.ECHO | self._termios.ICANON)
        mode[_CHARACTERS] = [*mode[_CHARACTERS]]
        for key, value in ((self._termios.VMIN, 1), (self._termios.VTIME, 0), (self._termios.VQUIT, b"\0")):
            mode[_CHARACTERS][key] = value
        with contextlib.suppress(self._termios.error, OSError):
            self._termios.tcsetattr(self._fd, self._termios.TCSANOW, mode)

    def _restore(self) -> None:
        with contextlib.suppress(self._termios.error, OSError):  # It may be closed already.
            self._termios.tcsetattr(self._fd, self._termios.TCSAFLUSH, self._before)

    def _stop(self, number: int, _: object) -> None:
        """Leave the terminal to the shell while the program is stopped."""
        self._restore()
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)
        signal.signal(number, self._stop)
        self._continue()  # Also where nothing could continue it, and the system did not stop it.

    def _continue(self, *_: object) -> None:
        """Take the terminal over again, if the program is in its foreground."""
        self.resumed = True
        with contextlib.suppress(OSError):
            if os.tcgetpgrp(self._fd) == os.getpgrp():
                self._take_over()


def key_names(text: str) -> list[str]:
    """Return the keys behind what a terminal has sent, without unknown sequences."""
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
    """Return the length of the escape sequence at the start of ``text``."""
    if len(text) < 2 or text[1] not in "[O":
        return 1
    for length, character in enumerate(text[2:], start=3):
        if "@" <= character <= "~":
            return length
    return len(text)
