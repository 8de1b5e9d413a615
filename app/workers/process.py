"""Processes that end alone: with their parent, at their time, and without anybody else.

A time limit is an alarm whose action is the system's own, to end the process: it comes also when the physics engine
never returns to Python.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from collections.abc import Callable

PR_SET_PDEATHSIG = 1


def die_with_parent(parent: int) -> None:
    """Be ended by the system when the process ``parent``, of which this one was forked, ends in whatever way."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # It ended before the line above.
            os._exit(1)


def set_deadline(seconds: float) -> None:
    """End this process that many seconds from now; 0: not any more."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, seconds)


def run_in_fork(work: Callable[[], int]) -> int:
    """Do ``work`` in a copy of this process as it is now, and wait; what it returned, or what ended the copy.

    As in multiprocessing.Process.exitcode: a status, or a signal's number below 0. ``work`` should not raise.
    """
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
    """Of a process that did not say it itself, for a person."""
    if exitcode is None or exitcode == -signal.SIGALRM:
        return f"took more than {limit_s:g} s"
    if exitcode == -signal.SIGKILL:
        return "its process was killed, by a person or because memory ran out (SIGKILL)"
    if exitcode < 0:
        return f"its process was ended by {_signal_name(-exitcode)}"
    return f"its process ended with status {exitcode}"


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
