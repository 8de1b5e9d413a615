"""The engine of a Ray cluster: each work item is a Ray task, and runs in a fresh process of its own there too.

A task returns rows and files, and this process writes them: the nodes need no common folder, and the loss of a node
costs only what it was running.
"""

from __future__ import annotations

import os
from collections.abc import Generator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from layflat.app.support.child_python import own_imports_only, socket_folder
from layflat.app.support.errors import LayflatError
from layflat.app.workers.fork_server import ONE_THREAD, ForkServer
from layflat.app.workers.item_progress import RunningItem
from layflat.app.workers.simulated_episode import EpisodeFactory
from layflat.app.workers.work_item import WorkItem, WorkResult, run_file
from layflat.app.workers.worker_process import POLL_S, Engine, NextWorkItem
from layflat.data.atomic_files import fsync_write
from layflat.data.system_errors import os_reason

SOCKET_NAME = f"/ray/session_2026-11-28_01-40-00_123456_{'9' * 7}/sockets/plasma_store"
"""Path that Ray adds to the folder for temporary files."""
AHEAD = 2
"""Tasks that are handed out for each core, so that none waits for this process."""
_SERVER: list[ForkServer] = []
"""Fork server of a Ray worker, from its first item on."""


def ray_engine(workers: int, address: str | None) -> Engine:
    """Return the engine of the cluster at ``address``, or of a local one of ``workers`` cores that ends with the run.

    LayflatError where Ray is not installed, or does not find the cluster.
    """
    ray = _ray()

    def run(
        next_item: NextWorkItem, folder: Path, make: EpisodeFactory
    ) -> Generator[WorkResult | Sequence[RunningItem], None, None]:
        _connect(ray, workers, address)
        try:
            yield from _run(ray, next_item, folder, make)
        finally:
            ray.shutdown()

    return run


def _ray() -> Any:
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # No usage data is sent unless the user wants it.
    try:
        import ray
    except ImportError:
        raise LayflatError(
            "--engine ray needs Ray, which is not installed; pip install 'layflat[ray]', or leave --engine local"
        ) from None
    return ray


def _connect(ray: Any, workers: int, address: str | None) -> None:
    for name, value in ONE_THREAD.items():
        os.environ.setdefault(name, value)
    if address is None:
        os.environ.setdefault("RAY_TMPDIR", socket_folder(SOCKET_NAME))
    own = {"num_cpus": workers, "include_dashboard": False} if address is None else {"address": address}
    try:
        with own_imports_only():  # Ray has its workers import from the current folder first.
            # "local": not a cluster that the environment or an earlier start has left somewhere.
            ray.init(**{"address": "local", **own}, log_to_driver=False, logging_level="error")
    except (ConnectionError, RuntimeError, ValueError) as error:
        words = " ".join(str(error).split())[:200]
        raise LayflatError(f"the Ray cluster at {address or 'this machine'} does not answer: {words}") from error


def _run(
    ray: Any, next_item: NextWorkItem, folder: Path, make: EpisodeFactory
) -> Generator[WorkResult | Sequence[RunningItem], None, None]:
    task = ray.remote(num_cpus=1, max_retries=0)(run_on_node)
    pending: dict[Any, WorkItem] = {}
    while True:
        most = AHEAD * max(1, int(ray.cluster_resources().get("CPU", 1)))
        while len(pending) < most and (item := next_item()) is not None:
            pending[task.remote(item, make)] = item
        if not pending:
            return
        ready, _ = ray.wait(list(pending), timeout=POLL_S)
        yield ()
        for reference in ready:
            yield _result(ray, reference, pending.pop(reference), folder)


def _result(ray: Any, reference: Any, item: WorkItem, folder: Path) -> WorkResult:
    """Write the files of a task that has ended, and return its result."""
    try:
        result, files = ray.get(reference)
    except (ray.exceptions.RayError, EOFError, OSError) as error:
        reason = f"its Ray worker was lost: {' '.join(str(error).split())[:200]}"
        return WorkResult(item, dict.fromkeys(item.run_ids, reason), {})
    try:
        for run, content in files.items():
            fsync_write(run_file(folder, run), content)
    except OSError as error:
        return replace(result, lost=dict.fromkeys(_missing(item, folder), ""), unwritable=os_reason(error))
    # A full disk on one node need not matter: another attempt may come to another node.
    return replace(result, unwritable=None)


def _missing(item: WorkItem, folder: Path) -> list[str]:
    return [run for run in item.run_ids if not run_file(folder, run).exists()]


def run_on_node(item: WorkItem, make: EpisodeFactory) -> tuple[WorkResult, dict[str, bytes]]:
    """Run an item in a Ray worker, by the fork server that it starts with its first item."""
    if not _SERVER:
        _SERVER.append(ForkServer())
    try:
        return _SERVER[0].run(item, make)
    except (EOFError, OSError):
        _SERVER.pop().close()
        raise
