"""Programs that tests start, interrupt and kill."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest


class Program:
    """A module that runs as a program, in a process group of its own; its output goes to files in ``folder``."""

    def __init__(self, folder: Path, module: str, *arguments: object) -> None:
        self._out, self._err = (folder / f"{name}-{time.monotonic_ns()}" for name in ("out", "err"))
        with self._out.open("w") as out, self._err.open("w") as err:
            words = [sys.executable, "-u", "-m", module, *map(str, arguments)]
            self.process = subprocess.Popen(words, stdout=out, stderr=err, start_new_session=True)

    @property
    def out(self) -> str:
        return self._out.read_text()

    @property
    def err(self) -> str:
        return self._err.read_text()

    def until(self, done: Callable[[], bool] | str, patience_s: float = 60.0) -> None:
        """Wait until ``done``, or until it has printed these words."""
        give_up = time.monotonic() + patience_s
        while not (done in self.out + self.err if isinstance(done, str) else done()):
            assert self.process.poll() is None, f"the program ended before {done!r}: {self.err}"
            assert time.monotonic() < give_up, f"the program has not come to {done!r}: {self.err}"
            time.sleep(0.02)

    def wait(self, timeout_s: float = 120.0) -> int:
        return self.process.wait(timeout_s)

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()

    def interrupt(self) -> None:
        """Press Ctrl-C, and check that the program ends as it should."""
        os.killpg(self.process.pid, signal.SIGINT)
        assert self.wait(30) == 130
        assert self.err.splitlines()[-1].startswith("layflat: interrupted")
        assert "Traceback" not in self.err
        assert self.none_left()

    def running(self) -> list[psutil.Process]:
        """Return the processes of the group that have not ended."""
        return [process for process in psutil.process_iter() if self._runs(process)]

    def none_left(self, patience_s: float = 10.0) -> bool:
        """Whether every process of the group ends in time."""
        give_up = time.monotonic() + patience_s
        while self.running():
            if time.monotonic() > give_up:
                return False
            time.sleep(0.05)
        return True

    def _runs(self, process: psutil.Process) -> bool:
        try:
            return process.status() != psutil.STATUS_ZOMBIE and os.getpgid(process.pid) == self.process.pid
        except (ProcessLookupError, psutil.NoSuchProcess):
            return False


@pytest.fixture
def start_program(tmp_path_factory) -> Iterator[Callable[..., Program]]:
    """``start_program(module, *arguments)``; what still runs at the end of the test is killed."""
    programs: list[Program] = []

    def start(module: str, *arguments: object) -> Program:
        programs.append(Program(tmp_path_factory.mktemp("output"), module, *arguments))
        return programs[-1]

    yield start
    for program in programs:
        if program.process.poll() is None:
            os.killpg(program.process.pid, signal.SIGKILL)
            program.process.wait()
