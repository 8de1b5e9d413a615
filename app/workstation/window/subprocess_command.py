"""A command of ``layflat`` in the background: what it prints, how far it is, and its end.

The window runs the very command that a person would type, so nothing that the command line can do to a data set or a
model works otherwise here, and what is shown can be repeated in a terminal.
"""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import signal
import subprocess
import sys
import threading
from collections import deque
from pathlib import Path
from typing import IO

from layflat.app.support.errors import INTERRUPTED

LINES_MAX = 400
CANCEL_S = 10.0
"""Time for a command to end when it is cancelled; it keeps what it has finished."""
ASK_AGAIN_S = 2.0
_PROGRESS = re.compile(r"\[ *(\d+) %\] (.*)")


class SubprocessCommand:
    """One running command."""

    def __init__(self, arguments: list[str], *, folder: Path | None = None) -> None:
        """``arguments`` of ``layflat``; relative paths are those of ``folder``."""
        self.arguments = arguments
        self.lines: deque[str] = deque(maxlen=LINES_MAX)
        """What it printed as its result, and at last its sentence where it failed."""
        self.share = 0.0
        """0..1 of the expected time."""
        self.doing = ""
        """What it says that it is doing."""
        self.cancelled = False
        self._process = subprocess.Popen(
            [sys.executable, "-m", "layflat.app.cli.main", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            cwd=folder,
            env={**os.environ, "PYTHONUNBUFFERED": "1", "COLUMNS": "100"},
            text=True,
            errors="replace",
        )
        self._threads = [
            threading.Thread(target=self._listen, args=(stream,), daemon=True)
            for stream in (self._process.stdout, self._process.stderr)
        ]
        for thread in self._threads:
            thread.start()

    @property
    def told(self) -> str:
        """The command as one would type it."""
        return shlex.join(["layflat", *self.arguments])

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def status(self) -> int | None:
        """Exit status; None while it runs."""
        if self._process.poll() is None or any(thread.is_alive() for thread in self._threads):
            return None
        return self._process.returncode

    def outcome(self) -> str:
        """How it ended, for a person; empty while it runs."""
        if self.status is None:
            return ""
        if self.status == 0:
            return "done"
        return "cancelled" if self.cancelled or self.status == INTERRUPTED else f"failed, exit status {self.status}"

    def cancel(self) -> None:
        """As Ctrl-C in a terminal; returns at once."""
        if not self.cancelled:
            self.cancelled = True
            threading.Thread(target=self._interrupt, daemon=True).start()

    def _interrupt(self) -> None:
        """A Python program may lose a Ctrl-C, in a callback of an import or of a fork: then it gets another."""
        for _ in range(int(CANCEL_S / ASK_AGAIN_S)):
            self._process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(ASK_AGAIN_S)
                return
        self._process.kill()

    def close(self) -> None:
        """End it, if it still runs; nothing of it is left behind."""
        if self._process.poll() is None:
            self.cancel()
            self._process.wait()
        for thread in self._threads:
            thread.join(2.0)

    def _listen(self, stream: IO[str] | None) -> None:
        """Progress lines move the bar, all others are shown."""
        if stream is None:
            return
        with stream:
            for line in stream:
                found = _PROGRESS.match(line.strip())
                if found:
                    self.share, self.doing = int(found.group(1)) / 100, found.group(2)
                elif line.strip():
                    self.lines.append(line.rstrip())
