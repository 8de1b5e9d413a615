"""Work for a bench process that has no bench: counts steps, and can be told to die in several ways."""

from __future__ import annotations

import os
import signal
import time
from typing import Any

from layflat.app.workstation.session.bench_process import Endpoint, Request
from layflat.app.workstation.session.rate_limiter import RateLimiter
from layflat.sim.errors import SimError

STEP_S = 0.05


class FakeWork:
    """Steps from the start on; of the last ones it says when each began and which input it acted on."""

    def __init__(self, order: Request, desk: Endpoint) -> None:
        if order.get("refuse"):
            raise SimError("this bench cannot be made")
        self._desk = desk
        self._cadence = RateLimiter(STEP_S)
        self._ends = str(order.get("leaves", ""))
        self._n_steps: list[tuple[float, float]] = []
        self.over = False

    def obey(self, order: Request) -> None:
        if order["do"] == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        if order["do"] == "fail":
            raise SimError("the cloth is on fire; put it out")
        if order["do"] == "over":
            self.over = True

    def advance(self) -> float:
        left_s = self._cadence.left_s()
        if left_s > 0:
            return left_s
        self._cadence.begin()
        began_s, letter = time.monotonic(), self._desk.letter()
        self._n_steps.append((began_s, 0.0 if letter is None else letter.stamp_s))
        del self._n_steps[:-200]
        return 0.0

    def status(self) -> dict[str, Any]:
        return {"steps": self._n_steps}

    def close(self) -> None:
        if self._ends:
            with open(self._ends, "w", encoding="utf-8") as file:
                file.write("kept")
