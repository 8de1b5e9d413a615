"""Ctrl-C, SIGTERM and a closed terminal, as a question of the program's own loop."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def stop_on_signals(*, impatient: bool = True) -> Iterator[Callable[[], bool]]:
    """Let Ctrl-C, SIGTERM and a closed terminal end the loop where it is safe, with everything saved.

    Yields a function that returns whether one has come; if ``impatient``, a second Ctrl-C interrupts at once.
    """
    received: list[int] = []

    def handle(number: int, _: object) -> None:
        if impatient and number == signal.SIGINT and received:
            raise KeyboardInterrupt
        received.append(number)

    numbers = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP] if os.name == "posix" else [signal.SIGINT]
    before = {number: signal.signal(number, handle) for number in numbers}
    try:
        yield lambda: bool(received)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
