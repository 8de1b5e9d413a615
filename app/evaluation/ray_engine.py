"""The engine of a Ray cluster: each group is a task, and runs in a fresh process inside of it all the same.

Only the task's answer comes back, rows and files of a group; this process writes them. So the nodes need no common
folder, and a node that is lost costs what it was at.
"""

from __future__ import annotations

import os
from collections.abc import Generator
from dataclasses import replace
from pathlib import Path
from typing import Any

from layflat.app.evaluation.fork_server import ONE_THREAD, ForkServer
from layflat.app.evaluation.local_engine import LOOK_S, Engine, NextWorkItem, WorkResult
from layflat.app.evaluation.plan import WorkItem
from layflat.app.evaluation.work_item import EpisodeFactory, run_file
from layflat.app.support.errors import LayflatError
from layflat.data.atomic_files import fsync_write, os_reason

AHEAD = 2
"""Tasks that are handed out for each core, so that none waits for this process."""
_SERVER: list[ForkServer] = []
"""Of a Ray worker, from its first group on."""


def ray_engine(workers: int, address: str | None) -> Engine:
    """On the cluster at ``address``, or else on one of ``workers`` cores that is started here and ends with the batch.

    LayflatError where Ray is not installed, or does not find the cluster.
    """
    ray = _ray()

    def run(next_group: NextWorkItem, folder: Path, play: EpisodeFactory) -> Generator[WorkResult | None, None, None]:
        _connect(ray, workers, address)
        try:
            yield from _run(ray, next_group, folder, play)
        finally:
            ray.shutdown()

    return run


def _ray() -> Any:
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # Nothing is told to anybody unless somebody wishes it.
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
    own = {"num_cpus": workers, "include_dashboard": False} if address is None else {"address": address}
    try:
        # "local": not a cluster that the environment or an earlier start has left somewhere.
        ray.init(**{"address": "local", **own}, log_to_driver=False, logging_level="error")
    except (ConnectionError, RuntimeError, ValueError) as error:
        words = " ".join(str(error).split())[:200]
        raise LayflatError(f"the Ray cluster at {address or 'this machine'} does not answer: {words}") from error


def _run(
    ray: Any, next_group: NextWorkItem, folder: Path, play: EpisodeFactory
) -> Generator[WorkResult | None, None, None]:
    task = ray.remote(num_cpus=1, max_retries=0)(run_on_node)
    pending: dict[Any, WorkItem] = {}
    while True:
        most = AHEAD * max(1, int(ray.cluster_resources().get("CPU", 1)))
        while len(pending) < most and (group := next_group()) is not None:
            pending[task.remote(group, play)] = group
        if not pending:
            return
        ready, _ = ray.wait(list(pending), timeout=LOOK_S)
        yield None
        for reference in ready:
            yield _end(ray, reference, pending.pop(reference), folder)


def _end(ray: Any, reference: Any, group: WorkItem, folder: Path) -> WorkResult:
    """Of a task that has ended: its files are written here."""
    try:
        end, files = ray.get(reference)
    except (ray.exceptions.RayError, EOFError, OSError) as error:
        reason = f"its Ray worker was lost: {' '.join(str(error).split())[:200]}"
        return WorkResult(group, dict.fromkeys(group.run_ids, reason), {})
    try:
        for run, content in files.items():
            fsync_write(run_file(folder, run), content)
    except OSError as error:
        return replace(end, lost=dict.fromkeys(_missing(group, folder), ""), unwritable=os_reason(error))
    # That the node's disk is full is that node's trouble: another try may come to another node.
    return replace(end, unwritable=None)


def _missing(group: WorkItem, folder: Path) -> list[str]:
    return [run for run in group.run_ids if not run_file(folder, run).exists()]


def run_on_node(group: WorkItem, play: EpisodeFactory) -> tuple[WorkResult, dict[str, bytes]]:
    """In a Ray worker: by the server that it has from its first group on."""
    if not _SERVER:
        _SERVER.append(ForkServer())
    try:
        return _SERVER[0].run(group, play)
    except (EOFError, OSError):
        _SERVER.pop().close()
        raise
