"""Why a process ended that did not report it, in words."""

from __future__ import annotations

import faulthandler
import os
import signal

import pytest

from layflat.app.workers import process
from layflat.app.workers.process import describe_exit_status, run_in_fork


def die(number: int) -> int:
    faulthandler.disable()  # pytest's would print a traceback of the signal
    os.kill(os.getpid(), number)
    return 0


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (signal.SIGKILL, "its process was killed (SIGKILL), probably because memory ran out"),
        (signal.SIGSEGV, "its process was ended by SIGSEGV"),
        (signal.SIGRTMIN + 3, f"its process was ended by signal {signal.SIGRTMIN + 3}"),
    ],
)
def test_a_signal_has_its_name_and_advice(number, words):
    assert describe_exit_status(run_in_fork(lambda: die(number)), 9.0).startswith(words)


def test_a_limit_on_memory_is_named(monkeypatch):
    monkeypatch.setattr(process, "memory_limit_bytes", lambda: 2 * 10**9)
    sentence = describe_exit_status(-signal.SIGKILL, 9.0)
    assert "(the limit here is 2.0 GB): use fewer --workers" in sentence


def test_a_status_stays_a_status():
    assert describe_exit_status(run_in_fork(lambda: 7), 9.0) == "its process ended with status 7"
