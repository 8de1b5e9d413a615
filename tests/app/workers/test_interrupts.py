"""Ctrl-C waits for what must not be cut in two, and is never lost."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator

import pytest

from layflat.app.workers.interrupts import defer_interrupts
from layflat.app.workers.process import configure_child, run_in_fork


@pytest.fixture(autouse=True)
def usual() -> Iterator[None]:
    """A program that was begun in the background hears no Ctrl-C at all."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_ctrl_c_comes_when_the_body_is_over():
    done = []

    def body() -> None:
        with defer_interrupts():
            os.kill(os.getpid(), signal.SIGINT)
            done.append("all of it")

    with pytest.raises(KeyboardInterrupt):
        body()
    assert done == ["all of it"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_ctrl_c_in_a_callback_of_a_fork_is_not_lost():
    armed = True

    def press() -> None:
        if armed:
            os.kill(os.getpid(), signal.SIGINT)

    def body() -> None:
        with defer_interrupts():
            child = os.fork()
            if child == 0:
                os._exit(0)
            os.waitpid(child, 0)

    os.register_at_fork(before=press)
    try:
        with pytest.raises(KeyboardInterrupt):
            body()
    finally:
        armed = False


def test_an_error_of_the_body_comes_through():
    with pytest.raises(ZeroDivisionError), defer_interrupts():
        _ = 1 / 0
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_in_other_threads_nothing_is_touched():
    seen = []

    def body() -> None:
        with defer_interrupts():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=body)
    thread.start()
    thread.join()
    assert seen == [signal.default_int_handler]


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 0), (signal.SIGTERM, -signal.SIGTERM)])
def test_a_worker_leaves_ctrl_c_to_its_parent_and_ends_when_it_is_asked_to(number, status):
    def work() -> int:
        configure_child()
        os.kill(os.getpid(), number)
        return 0

    before = signal.signal(signal.SIGTERM, lambda *_: None)  # A handler of the parent's own is not the worker's.
    try:
        assert run_in_fork(work) == status
    finally:
        signal.signal(signal.SIGTERM, before)
