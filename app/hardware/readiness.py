"""Readiness: measured rates, delays and noise of a station, and whether it may be used."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from layflat.app.hardware.realsense_camera import CameraFrame
from layflat.app.hardware.station_environment import FRAME_AGE_S, StationEnvironment
from layflat.data.types import STEP_S

STEPS, NOISE_FRAMES = 100, 10
JITTER_MS, DELAY_MS, ERROR_MM, NOISE_MM = 10.0, 60.0, 10.0, 4.0
"""Most of the 99th percentile of a step's jitter, from frame to command, of the arm's error at rest, of depth noise."""


@dataclass(frozen=True)
class Reading:
    """One measured quantity."""

    name: str
    value: float
    unit: str
    limit: float | None = None

    @property
    def good(self) -> bool:
        """Whether it is within its limit."""
        return self.limit is None or self.value <= self.limit


def measure(env: StationEnvironment, *, steps: int = STEPS) -> list[Reading]:
    """Hold the arm for ``steps`` control steps while the camera runs; return what was measured.

    The jitter is that of the moments at which the steps' commands are sent, by the robot's clock. From frame to
    command: from the arrival of the frame to the command, perception included, with nothing to decide.
    """
    arm, camera = env.arm, env.camera
    home, dropped, begin = arm.position(), camera.dropped, arm.time_s()
    ends, delays, errors = [], [], []
    frames: list[CameraFrame] = []
    for k in range(1, steps + 1):
        arm.wait_until(begin + k * STEP_S)
        frames.append(camera.frame(after_s=time.monotonic() - FRAME_AGE_S))
        env.perceive(frames[-1])
        arm.move(home, STEP_S)
        ends.append(arm.time_s())
        delays.append(time.monotonic() - frames[-1].seen_s)
        errors.append(arm.position() - home)
    late = np.array(ends) - begin - STEP_S * np.arange(1, steps + 1)
    jitter = np.abs(late - np.median(late))
    rate = (frames[-1].number - frames[0].number) / max(frames[-1].seen_s - frames[0].seen_s, 1e-9)
    stack = np.stack([frame.depth for frame in frames[:NOISE_FRAMES]])
    seen = (stack > 0).all(axis=0)
    noise = float(np.median(np.std(stack, axis=0)[seen])) if seen.any() else np.inf
    return [
        Reading("step jitter, 99th percentile", 1e3 * float(np.percentile(jitter, 99)), "ms", JITTER_MS),
        Reading("frame to command, 99th percentile", 1e3 * float(np.percentile(delays, 99)), "ms", DELAY_MS),
        Reading("camera rate", float(rate), "1/s"),
        Reading("frames lost", float(camera.dropped - dropped), ""),
        Reading("depth noise, median of pixels", 1e3 * noise, "mm", NOISE_MM),
        Reading("arm's error at rest, largest", 1e3 * float(np.abs(errors).max()), "mm", ERROR_MM),
    ]
