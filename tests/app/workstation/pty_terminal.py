"""A real terminal with the program in it."""

from __future__ import annotations

import fcntl
import os
import pty
import select
import subprocess
import sys
import termios
import time
from collections.abc import Sequence
from typing import Any

PATIENCE_S = 60.0
PROGRAM = (sys.executable, "-m", "layflat.app.cli.main")


class Terminal:
    """A pseudo-terminal with the program in it."""

    def __init__(self, *arguments: object, program: Sequence[str] = PROGRAM, **options: Any) -> None:
        self._mine, theirs = pty.openpty()
        self.before = termios.tcgetattr(theirs)
        self._theirs = theirs
        self.text = ""
        self._read = 0
        environment = options.pop("env", os.environ)
        environment = {name: value for name, value in environment.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
        self.child = subprocess.Popen(
            [*program, *map(str, arguments)],
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            env=environment,
            start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),  # So that Ctrl-C typed there interrupts.
            **options,
        )

    def type(self, keys: str) -> None:
        os.write(self._mine, keys.encode())

    def hold(self, key: str, seconds: float) -> None:
        """Repeat a key as a terminal does."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.type(key)
            time.sleep(0.04)

    def until(self, words: str) -> str:
        """Return what is shown up to these words, from where the last call ended."""
        end = time.monotonic() + PATIENCE_S
        while words not in self.text[self._read :]:
            if time.monotonic() > end or (self.child.poll() is not None and not self._more()):
                raise AssertionError(f"it never showed {words!r} after {self.text[self._read :]!r}")
            self._more()
        found = self.text.index(words, self._read) + len(words)
        shown, self._read = self.text[self._read : found], found
        return shown

    def _more(self) -> bool:
        if not select.select([self._mine], [], [], 0.05)[0]:
            return False
        try:
            text = os.read(self._mine, 65536)
        except OSError:  # Linux: the last program has left the terminal.
            return False
        self.text += text.decode(errors="replace")
        return bool(text)

    def begin(self, key: str = "s") -> None:
        """Start, through the countdown, and move for a few steps."""
        self.until(" hangs]")
        self.type("\r")
        self.until("move to start")
        self.hold(key, 0.6)
        self.until("RECORDING")

    def end(self) -> int:
        """Wait for the end, and return the exit status; everything that was shown is in ``text``."""
        end = time.monotonic() + PATIENCE_S
        while self.child.poll() is None and time.monotonic() < end:
            self._more()
        while self._more():
            pass
        return self.child.wait(1.0)

    def as_before(self) -> bool:
        return termios.tcgetattr(self._theirs) == self.before

    def close(self) -> None:
        if self.child.poll() is None:
            self.child.kill()
            self.child.wait()
        os.close(self._mine)
        os.close(self._theirs)
