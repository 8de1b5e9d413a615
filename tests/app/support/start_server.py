"""Starts the server of sessions or of work items, and prints the folder of a process that is forked from it."""

from __future__ import annotations

import os
import sys
from typing import Any

from layflat.app.support.child_python import fork_server_context
from layflat.app.support.errors import LayflatError
from layflat.app.workers.fork_server import ForkServer
from layflat.app.workers.work_item import WorkItem
from layflat.app.workstation.session.client import PRELOAD
from layflat.policy.spec import SCRIPTED, PolicySpec
from layflat.sim.config import SimConfig


def print_folder() -> None:
    print(os.getcwd())


def refuse(item: WorkItem, on_start: Any) -> Any:
    """Refuse a work item with the current folder as the reason."""
    raise LayflatError(os.getcwd())


def main(server: str) -> None:
    if server == "session":
        process = fork_server_context(PRELOAD).Process(target=print_folder)
        process.start()
        process.join()
        sys.exit(process.exitcode)
    running = ForkServer()
    try:
        item = WorkItem(policy=PolicySpec(builtin=SCRIPTED), config=SimConfig(robot="hanger"), seed=0)
        result, _ = running.run(item, refuse)
        print(*result.lost.values())
    finally:
        running.close()


if __name__ == "__main__":
    # Under its own name, by which a child finds what it runs.
    from layflat.tests.app.support import start_server

    start_server.main(sys.argv[1])
