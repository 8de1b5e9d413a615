"""Takes without a simulator, and a source that a test moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from layflat.app.workstation.session.episode_handle import EpisodeLost, EpisodeStatus
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput
from layflat.app.workstation.teleop.teleoperator import Button
from layflat.data.session.recorder import SessionRecorder
from layflat.data.session.saved_episode import SavedEpisode
from layflat.data.types import DragTarget, Episode, Outcome, StoppedBy
from layflat.sim.robots.registry import robot_spec


class DrawnTake:
    """Counts steps, and keeps a drawn episode of as many."""

    def __init__(self, seed: int, recorder: SessionRecorder, draw: Callable[..., Episode]) -> None:
        self.seed = seed
        self.hangs = True
        self.dies_at: int | None = None
        self.unstable_at: int | None = None
        self.corrects = False
        """Whether the person takes over from a policy: they hand back by a button alone."""
        self.work: Callable[[], None] = lambda: None
        """What happens during a step."""
        self.readings: list[TeleopInput] = []
        self.disturbed: list[str] = []
        self.discarded = False
        self._recorder = recorder
        self._draw = draw
        self._glance = EpisodeStatus()

    def ready(self) -> bool:
        return self.hangs

    def glance(self) -> EpisodeStatus:
        return self._glance

    def step(self, reading: TeleopInput, pull: DragTarget | None = None) -> EpisodeStatus:
        if len(self.readings) == self.dies_at:
            raise EpisodeLost("the simulation ended by itself")
        self.readings.append(reading)
        self.work()
        n_steps = len(self.readings)
        stop: StoppedBy | None = "unstable" if n_steps == self.unstable_at else None
        self._glance = EpisodeStatus(
            n_steps=n_steps,
            time_s=0.1 * n_steps,
            contact_portion=min(0.01 * n_steps, 1.0),
            stopped_by=stop,
            led=self.corrects and (reading.moving or self._glance.led),
        )
        return self._glance

    def disturb(self, name: str) -> None:
        self.disturbed.append(name)
        self._glance = replace(self._glance, disturbed=True)

    def hand_back(self) -> None:
        self._glance = replace(self._glance, led=False)

    def keep(self, outcome: Outcome, stopped_by: StoppedBy) -> SavedEpisode | None:
        if not self.readings:
            return None
        n_steps = len(self.readings)
        robot, cloth = self._recorder.robot, self._recorder.cloth
        episode = self._draw(robot, n_steps=n_steps, seed=self.seed, cloth=cloth, source="keyboard")
        return self._recorder.save(replace(episode, outcome=outcome, stopped_by=stopped_by))

    def discard(self) -> None:
        self.discarded = True


class HandSource:
    """Says what the test has put into it."""

    name = "keyboard"

    def __init__(self, robot: str = "hanger") -> None:
        self.motion = np.zeros(robot_spec(robot).size)
        self.controls: list[Command] = []
        self.connected = True
        self.rumbles: list[float] = []
        self.polled: list[float] = []
        self.on_poll: Callable[[], None] = lambda: None

    def poll(self) -> TeleopInput:
        self.on_poll()
        controls, self.controls = tuple(self.controls), []
        problem = "" if self.connected else "the pad is gone"
        motion = self.motion if self.connected else 0 * self.motion
        return TeleopInput(motion=motion, controls=controls, connected=self.connected, device="hands", problem=problem)

    def rumble(self, strength: float, seconds: float) -> None:
        self.rumbles.append(strength)

    def help(self) -> tuple[Button, ...]:
        return (Button("stick", "moves"),)

    def close(self) -> None: ...


@pytest.fixture
def hands() -> HandSource:
    return HandSource()
