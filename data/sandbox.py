"""Runs a function in a process of its own, with a limit on time and memory.

For untrusted files: when the HDF5 library crashes, loops or asks for all memory on damaged bytes, the calling program
continues.
"""

from __future__ import annotations

import contextlib
import faulthandler
import os
import resource
import signal
from collections.abc import Callable
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import TypeVar

T = TypeVar("T")


class CallError(Exception):
    """The function did not return a value; the message says why."""


def call_in_sandbox(function: Callable[[], T], *, limit_s: float, memory_bytes: int) -> T:
    """Return what ``function()`` returns in a forked process; CallError where it crashed, raised or took too long.

    ``memory_bytes`` is its limit on top of the memory of this process.
    """
    receiver, sender = Pipe(duplex=False)
    # Not multiprocessing's Process, which a pool's workers may not have.
    child = os.fork()
    if child == 0:
        _work(function, sender, limit_s, memory_bytes)
    sender.close()
    try:
        if not receiver.poll(limit_s):
            raise CallError(f"took more than {limit_s:.0f} s")
        fine, result = receiver.recv()
    except EOFError:
        raise CallError("ended the process that did it") from None
    finally:
        receiver.close()
        with contextlib.suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    if not fine:
        raise CallError(f"failed: {result}")
    return result  # type: ignore[no-any-return]


def _work(function: Callable[[], object], sender: Connection, limit_s: float, memory_bytes: int) -> None:
    """Run the function and end the process: code further up the parent's stack must not run twice."""
    try:
        faulthandler.disable()  # A crash here is an answer, not a fault of the program.
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            # Ends an endless loop also when the parent was killed.
            resource.setrlimit(resource.RLIMIT_CPU, (int(limit_s) + 1, int(limit_s) + 2))
            resource.setrlimit(resource.RLIMIT_AS, (_in_use() + memory_bytes, resource.RLIM_INFINITY))
        sender.send((True, function()))
    except BaseException as error:  # The parent reports any error in one sentence.
        with contextlib.suppress(Exception):
            sender.send((False, (str(error).splitlines() or [type(error).__name__])[0]))
    finally:
        os._exit(0)


def _in_use() -> int:
    """Return the address space of this process in bytes."""
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[0]) * resource.getpagesize()
