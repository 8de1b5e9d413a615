"""ForkServer: a process that has all modules loaded and runs work items for another one.

What is forked must have no threads, and a Ray worker has many. The module, run with a file descriptor, answers on the
socket that it inherits as that descriptor, and ends when its owner does.
"""

from __future__ import annotations

import socket
import subprocess
import sys
import tempfile
from multiprocessing.connection import Connection
from pathlib import Path

from layflat.app.support.child_python import start_python
from layflat.app.workers.process import configure_child
from layflat.app.workers.simulated_episode import EpisodeFactory
from layflat.app.workers.work_item import WorkItem, WorkResult, run_file
from layflat.app.workers.worker_process import WorkerProcess

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


class ForkServer:
    """The owner's end of the server."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair()
        self._process = start_python(
            "layflat.app.workers.fork_server",
            str(theirs.fileno()),
            env=ONE_THREAD,
            pass_fds=[theirs.fileno()],
            stdin=subprocess.DEVNULL,
        )
        theirs.close()
        self._connection: Connection = Connection(ours.detach())

    def run(self, item: WorkItem, make: EpisodeFactory) -> tuple[WorkResult, dict[str, bytes]]:
        """Return the result of an item, and the files of its runs; OSError or EOFError if the server has ended."""
        self._connection.send((item, make))
        result, files = self._connection.recv()
        return result, files

    def close(self) -> None:
        """End the server."""
        self._process.kill()
        self._process.wait()
        self._connection.close()


def serve(descriptor: int) -> None:
    """Run one item after the other until the owner hangs up."""
    configure_child()
    connection = Connection(descriptor)
    while True:
        try:
            item, make = connection.recv()
        except EOFError:
            return
        connection.send(_run(item, make))


def _run(item: WorkItem, make: EpisodeFactory) -> tuple[WorkResult, dict[str, bytes]]:
    with tempfile.TemporaryDirectory(prefix="layflat-item-") as name:
        folder = Path(name)
        result = WorkerProcess(item, folder, make).wait()
        runs = [run for run in item.run_ids if run not in result.lost]
        return result, {run: run_file(folder, run).read_bytes() for run in runs}


if __name__ == "__main__":
    serve(int(sys.argv[1]))
