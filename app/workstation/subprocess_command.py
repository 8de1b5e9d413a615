"""SubprocessCommand: a command of ``layflat`` in the background, with its output, progress and end.

The window runs the very command that a person would type, so data sets and models are treated as on the command line,
and what is shown can be repeated in a terminal.
"""

from __future__ import annotations

import contextlib
import re
import shlex
import signal
import subprocess
import threading
from collections import deque
from pathlib import Path
from typing import IO

from layflat.app.support.child_python import start_python
from layflat.app.support.errors import INTERRUPTED
from layflat.app.workers.process import describe_exit_status

MAX_LINES = 400
CANCEL_S = 10.0
"""Time for a command to end when it is cancelled; it keeps what it has finished."""
INTERRUPT_AGAIN_S = 2.0
_PROGRESS = re.compile(r"\[ *(\d+) %\] (.*)")


class SubprocessCommand:
    """One running command."""

    def __init__(self, arguments: list[str], *, folder: Path | None = None) -> None:
        """Start ``layflat`` with ``arguments``, in which relative paths are those of ``folder``."""
        self.arguments = arguments
        self.lines: deque[str] = deque(maxlen=MAX_LINES)
        """Printed results, and at last the error message where it failed."""
        self.progress = 0.0
        """Share of the expected time, 0..1."""
        self.activity = ""
        """Newest line of progress."""
        self.cancelled = False
        self._process = start_python(
            "layflat.app.cli.main",
            *arguments,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            cwd=folder,
            env={"PYTHONUNBUFFERED": "1", "PYTHONIOENCODING": "utf-8", "COLUMNS": "100"},
            encoding="utf-8",
            errors="replace",
        )
        self._threads = [
            threading.Thread(target=self._read, args=(stream,), daemon=True)
            for stream in (self._process.stdout, self._process.stderr)
        ]
        for thread in self._threads:
            thread.start()

    def describe(self) -> str:
        """Return the command as one would type it."""
        return shlex.join(["layflat", *self.arguments])

    @property
    def status(self) -> int | None:
        """Exit status; None while it runs."""
        if self._process.poll() is None or any(thread.is_alive() for thread in self._threads):
            return None
        return self._process.returncode

    @property
    def running(self) -> bool:
        """Whether it still runs."""
        return self.status is None

    def outcome(self) -> str:
        """Return how it ended, for a person; empty while it runs."""
        if self.status is None:
            return ""
        if self.status == 0:
            return "done"
        if self.cancelled or self.status == INTERRUPTED:
            return "cancelled"
        if self.status < 0:
            return f"failed: {describe_exit_status(self.status, 0.0)}"
        return f"failed, exit status {self.status}"

    def cancel(self) -> None:
        """Interrupt it as Ctrl-C does; return at once."""
        if not self.cancelled:
            self.cancelled = True
            threading.Thread(target=self._interrupt, daemon=True).start()

    def _interrupt(self) -> None:
        """Interrupt again where Python lost a Ctrl-C in a callback of an import or of a fork."""
        for _ in range(int(CANCEL_S / INTERRUPT_AGAIN_S)):
            self._process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(INTERRUPT_AGAIN_S)
                return
        self._process.kill()

    def close(self) -> None:
        """End it, if it still runs."""
        if self._process.poll() is None:
            self.cancel()
            self._process.wait()
        for thread in self._threads:
            thread.join(2.0)

    def _read(self, stream: IO[str] | None) -> None:
        """Take lines of progress apart, and keep all others."""
        if stream is None:
            return
        with stream:
            for line in stream:
                found = _PROGRESS.match(line.strip())
                if found:
                    self.progress, self.activity = int(found.group(1)) / 100, found.group(2)
                elif line.strip():
                    self.lines.append(line.rstrip())
