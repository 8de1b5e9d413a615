"""Delaying Ctrl-C until nothing is half done."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any


@dataclass
class Interrupts:
    """Whether Ctrl-C has been received."""

    received: bool = False


@contextmanager
def note_interrupts() -> Iterator[Interrupts]:
    """Only note Ctrl-C while the body runs; the body checks what is yielded."""
    interrupts = Interrupts()

    def note(number: int, frame: object) -> None:
        interrupts.received = True

    with _handler(note):
        yield interrupts


@contextmanager
def defer_interrupts() -> Iterator[None]:
    """Raise KeyboardInterrupt for a Ctrl-C while the body runs only when the body is over.

    Saving a result and forking must not be interrupted. Python runs callbacks around a fork that take and release
    locks (of logging, of h5py); an exception in one of them is printed and forgotten, the Ctrl-C with it, and the lock
    stays taken: the next fork then waits forever.
    """
    with note_interrupts() as interrupts:
        yield
    if interrupts.received:
        raise KeyboardInterrupt


@contextmanager
def _handler(handle: Callable[[int, Any], None]) -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield  # Ctrl-C never comes to this thread.
        return
    before = signal.signal(signal.SIGINT, handle)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
