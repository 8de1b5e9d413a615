"""A warm process that runs groups for another one: what is forked must have no threads, and a Ray worker has many.

``python -m layflat.app.evaluation.fork_server FD`` answers on the socket that it has been given, and ends when its
owner does.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import tempfile
from multiprocessing.connection import Connection
from pathlib import Path

import cv2

from layflat.app.evaluation.local_engine import WorkerProcess, WorkResult
from layflat.app.evaluation.plan import WorkItem
from layflat.app.evaluation.work_item import EpisodeFactory, run_file
from layflat.app.workers.process import die_with_parent

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


class ForkServer:
    """The owner's end."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair()
        environment = {
            **os.environ,
            **ONE_THREAD,
            "PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path),
        }
        words = [sys.executable, "-m", "layflat.app.evaluation.fork_server", str(theirs.fileno())]
        self._process = subprocess.Popen(words, env=environment, pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL)
        theirs.close()
        self._line: Connection = Connection(ours.detach())

    def run(self, group: WorkItem, play: EpisodeFactory) -> tuple[WorkResult, dict[str, bytes]]:
        """How the group ended, and the files of its runs; OSError or EOFError where the server has ended instead."""
        self._line.send((group, play))
        end, files = self._line.recv()
        return end, files

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        self._line.close()


def serve(descriptor: int) -> None:
    """One group after the other until the owner hangs up."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    die_with_parent(os.getppid())
    cv2.setNumThreads(1)
    line = Connection(descriptor)
    while True:
        try:
            group, play = line.recv()
        except EOFError:
            return
        line.send(_run(group, play))


def _run(group: WorkItem, play: EpisodeFactory) -> tuple[WorkResult, dict[str, bytes]]:
    with tempfile.TemporaryDirectory(prefix="layflat-group-") as name:
        folder = Path(name)
        end = WorkerProcess(group, folder, play).wait()
        runs = [run for run in group.run_ids if run not in end.lost]
        return end, {run: run_file(folder, run).read_bytes() for run in runs}


if __name__ == "__main__":
    import layflat.app.evaluation.simulated_episode  # noqa: F401 - so that it is there when the first group comes

    serve(int(sys.argv[1]))
