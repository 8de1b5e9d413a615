"""Child processes that record until they end or are killed."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable


def run_child(
    work: Callable[[int], None], *, kill_after_s: float | None = None
) -> tuple[int, list[list[str]], float | None]:
    """Run ``work(pipe)`` in a child; return its exit status (or -signal), the words of its lines, and the kill time.

    With ``kill_after_s`` it is killed that long after its first line. A line that was cut off is left out.
    """
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        status = 1
        os.close(reading)  # A child whose parent was killed must not wait for a reader.
        try:
            work(writing)
            status = 0
        finally:
            os._exit(status)  # Nothing of pytest may run twice.
    os.close(writing)
    killed_at = None
    with os.fdopen(reading) as pipe:
        lines = [pipe.readline()] if kill_after_s is not None else []
        if kill_after_s is not None:
            time.sleep(kill_after_s)
            killed_at = time.monotonic()
            os.kill(pid, signal.SIGKILL)
        lines += pipe
    status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    return status, [line.split() for line in lines if line.endswith("\n")], killed_at
