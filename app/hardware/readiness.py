"""Readiness: measured rates, delays and noise of a station, and whether it may be used."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from layflat.app.hardware.franka_arm import FrankaArm
from layflat.app.hardware.realsense_camera import RealSenseCamera
from layflat.data.arrays import FloatArray
from layflat.data.types import STEP_S

STEPS = 100
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


def measure(arm: FrankaArm, camera: RealSenseCamera, *, steps: int = STEPS) -> list[Reading]:
    """Hold the arm for ``steps`` control steps while the camera runs; return what was measured.

    The jitter is that of the moment at which a step's command is sent, against 10 Hz of the robot's clock. From frame
    to command: from the arrival of the frame that is used to the command, with nothing to decide.
    """
    home = arm.position()
    ends, delays, frames, errors = [], [], [], []
    depths: list[FloatArray] = []
    dropped = camera.dropped
    begin = arm.time_s()
    for k in range(1, steps + 1):
        arm.wait_until(begin + k * STEP_S)
        frame = camera.frame()
        arm.move(home, STEP_S)
        ends.append(time.monotonic())
        delays.append(ends[-1] - frame.seen_s)
        frames.append((frame.number, frame.seen_s))
        errors.append(arm.position() - home)
        if len(depths) < 10:
            depths.append(frame.depth)
    jitter = np.abs(np.diff(ends) - STEP_S)
    rate = (frames[-1][0] - frames[0][0]) / max(frames[-1][1] - frames[0][1], 1e-9)
    stack = np.stack(depths)
    noise = np.median(np.std(stack, axis=0)[(stack > 0).all(axis=0)]) if (stack > 0).any() else np.inf
    return [
        Reading("step jitter, 99th percentile", 1e3 * float(np.percentile(jitter, 99)), "ms", JITTER_MS),
        Reading("frame to command, 99th percentile", 1e3 * float(np.percentile(delays, 99)), "ms", DELAY_MS),
        Reading("camera rate", float(rate), "1/s"),
        Reading("frames lost", float(camera.dropped - dropped), ""),
        Reading("depth noise, median of pixels", 1e3 * float(noise), "mm", NOISE_MM),
        Reading("arm's error at rest, largest", 1e3 * float(np.abs(errors).max()), "mm", ERROR_MM),
    ]
