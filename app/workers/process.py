"""Child processes: ended with their parent and at their deadline, and how one ended.

A deadline is an alarm with the system's default action, which ends the process: it works even when the physics engine
never returns to Python.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Any

import cv2
from pebble import ProcessFuture, ProcessPool

from layflat.app.support.machine import memory_limit_bytes
from layflat.app.workers.interrupts import defer_interrupts

PR_SET_PDEATHSIG = 1


def die_with_parent(parent: int) -> None:
    """Have the system end this process when ``parent``, which forked it, ends for any reason."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # It ended before the line above.
            os._exit(1)


def configure_child(parent: int | None = None) -> None:
    """Prepare a process that was forked or started by ``parent`` (default: its parent now) for one piece of work."""
    # Ctrl-C reaches the whole process group; only the parent decides what to keep, and then ends the others.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # A forked child inherits the parent's SIGTERM handler; restore the default.
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    die_with_parent(os.getppid() if parent is None else parent)
    cv2.setNumThreads(1)


def set_deadline(seconds: float) -> None:
    """End this process that many seconds from now; 0 removes the deadline."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, seconds)


def run_in_fork(work: Callable[[], int]) -> int:
    """Run ``work`` in a copy of this process as it is now, wait for it, and return how it ended.

    Returns a status, or a signal's number below 0, as multiprocessing.Process.exitcode. ``work`` should not raise.
    """
    # Here, where OpenCV's threads are: a fork, which lacks them, would wait forever for them to end.
    cv2.setNumThreads(1)
    parent = os.getpid()
    child = os.fork()
    if child == 0:
        status = 1
        try:
            die_with_parent(parent)
            status = work()
        finally:
            os._exit(status)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def describe_exit_status(exitcode: int | None, limit_s: float) -> str:
    """Describe why a process ended that did not report it."""
    if exitcode is None or exitcode == -signal.SIGALRM:
        return f"took more than {limit_s:g} s"
    if exitcode == -signal.SIGKILL:
        limit = memory_limit_bytes()
        where = "" if limit is None else f" (the limit here is {limit / 1e9:.1f} GB)"
        reason = f"its process was killed (SIGKILL), probably because memory ran out{where}"
        return f"{reason}: use fewer --workers or --no-images"
    if exitcode < 0:
        return f"its process was ended by {_signal_name(-exitcode)}"
    return f"its process ended with status {exitcode}"


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


class _Pool(ProcessPool):
    """A pool whose first task forks in the caller's thread, which is the one that Ctrl-C comes to."""

    def schedule(self, *args: Any, **kwargs: Any) -> ProcessFuture:
        with defer_interrupts():
            return super().schedule(*args, **kwargs)


@contextmanager
def process_pool(workers: int) -> Iterator[ProcessPool]:
    """Yield a pool that runs every function in a fresh process; left with an error or Ctrl-C, it ends them at once."""
    # Here, where OpenCV's threads are: a fork, which lacks them, would wait forever for them to end.
    cv2.setNumThreads(1)
    pool = _Pool(max_workers=workers, max_tasks=1, context=get_context("fork"), initializer=configure_child)
    finished = False
    try:
        yield pool
        finished = True
    finally:
        if finished:
            pool.close()  # type: ignore[no-untyped-call]
        else:
            pool.stop()  # type: ignore[no-untyped-call]
        pool.join()
