"""Runs a function in a process of its own, with a limit on time and memory.

For files that cannot be trusted: should the HDF5 library crash, loop or ask for all memory on damaged bytes, the
program that asked goes on.
"""

from __future__ import annotations

import contextlib
import faulthandler
import multiprocessing
import resource
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import TypeVar

Result = TypeVar("Result")


class Isolated(Exception):
    """The function did not come back; says why."""


def isolated(function: Callable[[], Result], *, limit_s: float, memory_bytes: int) -> Result:
    """What ``function()`` returns in a forked process; Isolated where it crashed, raised or took too long.

    ``memory_bytes`` may be asked for on top of what this process has.
    """
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    child = context.Process(target=_work, args=(function, sender, memory_bytes), daemon=True)
    child.start()
    sender.close()
    try:
        if not receiver.poll(limit_s):
            raise Isolated(f"took more than {limit_s:.0f} s")
        fine, result = receiver.recv()
    except EOFError:
        child.join()
        raise Isolated(f"ended the process that read it (status {child.exitcode})") from None
    finally:
        receiver.close()
        child.kill()
        child.join()
    if not fine:
        raise Isolated(str(result))
    return result  # type: ignore[no-any-return]


def _work(function: Callable[[], object], sender: Connection, memory_bytes: int) -> None:
    faulthandler.disable()  # A crash here is an answer, not a fault of the program.
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (_in_use() + memory_bytes, resource.RLIM_INFINITY))
    try:
        sender.send((True, function()))
    except Exception as error:  # Whatever it was, the other side says it in one sentence.
        sender.send((False, (str(error).splitlines() or [type(error).__name__])[0]))


def _in_use() -> int:
    """Address space of this process in bytes."""
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[0]) * resource.getpagesize()
