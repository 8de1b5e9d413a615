"""Ctrl-C at the right moment."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def defer_interrupts() -> Iterator[None]:
    """Ctrl-C while the body runs comes as a KeyboardInterrupt when it is over.

    For what must not be cut in two: keeping a result, and forking. Python runs callbacks around a fork that take and
    give back locks (of logging, of h5py); an exception in one of them is printed and forgotten, the Ctrl-C with it,
    and the lock stays taken: the next fork then waits for ever.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # Ctrl-C never comes here.
        return
    came: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if came:
        raise KeyboardInterrupt
