"""A take's process tells the window of its bench after each step."""

from __future__ import annotations

import os
import time

from layflat.app.workstation.session.frame_channel import FrameChannel
from layflat.app.workstation.teleop.teleop_input import TeleopInput
from layflat.policy.runner import EpisodeRunner
from layflat.sim.simulation import ClothSimulation


class FramePublisher:
    """What a take is attended by (``take_process.Attend``)."""

    def __init__(self, moments: FrameChannel) -> None:
        self._moments = moments

    def __call__(self, run: EpisodeRunner, reading: TeleopInput) -> None:
        if not isinstance(run.env, ClothSimulation):
            raise TypeError("only a simulation can be published to the window")
        now = time.monotonic()
        self._moments.tell(
            run.env,
            run.observation,
            run.env.ground_truth(),
            # Every take has a process of its own.
            episode=os.getpid(),
            step=run.n_steps,
            phase=run.steps[-1].phase if run.steps else "place",
            input_s=reading.stamp_s if run.steps else 0.0,
            work_s=now - reading.stamp_s if reading.stamp_s else 0.0,
            led=bool(run.steps) and run.steps[-1].intervention,
        )
