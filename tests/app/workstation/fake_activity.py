"""Work of child processes without a simulation: an activity that can be made to die, and a writer of values."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from layflat.app.workstation.session.activity_process import Endpoint, Message
from layflat.app.workstation.session.latest_value import LatestValue
from layflat.app.workstation.session.rate_limiter import RateLimiter
from layflat.app.workstation.session.requests import ActivityRequest
from layflat.sim.errors import SimError

STEP_S = 0.05


@dataclass(frozen=True, kw_only=True)
class FakeRequest(ActivityRequest):
    refuse: bool = False
    saves: Path | None = None
    """File that is written at the end."""


class FakeActivity:
    """Its status has the start of each of the last steps, and the stamp of the input that it acted on."""

    def __init__(self, request: FakeRequest, endpoint: Endpoint) -> None:
        if request.refuse:
            raise SimError("this simulation cannot be made")
        self._endpoint = endpoint
        self._limiter = RateLimiter(STEP_S)
        self._saves = request.saves
        self._steps: list[tuple[float, float]] = []
        self.done = False

    def handle_request(self, request: Message) -> None:
        if request["request"] == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        if request["request"] == "fail":
            raise SimError("the cloth has diverged")
        self.done = request["request"] == "finish"

    def step(self) -> float:
        remaining_s = self._limiter.remaining_s()
        if remaining_s > 0:
            return remaining_s
        self._limiter.start_step()
        started_s, sample = time.monotonic(), self._endpoint.latest_input()
        self._steps.append((started_s, 0.0 if sample is None else sample.stamp_s))
        del self._steps[:-200]
        return 0.0

    def status(self) -> dict[str, Any]:
        return {"steps": self._steps}

    def close(self) -> None:
        if self._saves is not None:
            self._saves.write_text("saved")


WIDE = np.dtype([("number", "i8"), ("filling", "i8", 20_000)])
"""Large enough that copying it takes longer than a process may run at a time."""


def write_for(value: LatestValue, seconds: float) -> None:
    """Write values one after another, each of one number."""
    number, end = 0, time.monotonic() + seconds
    while time.monotonic() < end:
        number += 1
        value.write(number=number, filling=np.full(20_000, number))
