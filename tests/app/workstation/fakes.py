"""Recordings without a simulator or a device."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from layflat.app.workstation.session.episode_handle import EpisodeLost, EpisodeStatus
from layflat.app.workstation.session.recording_session import COUNTDOWN_S, RecordingSession
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput, zero_input
from layflat.app.workstation.teleop.teleoperator import Button
from layflat.data.session.recorder import SessionRecorder
from layflat.data.session.saved_episode import SavedEpisode
from layflat.data.types import DragTarget, Episode, GroundTruth, Observation, Outcome, Step, StoppedBy
from layflat.tests.factories import HANGER

AT_REST = zero_input(HANGER)
FORWARD = TeleopInput(motion=np.array([1.0, 0.0]))
DISCONNECTED = zero_input(HANGER, connected=False, problem="the gamepad was disconnected; plug it in again")


def episode_of_zeros(n_steps: int, seed: int, stopped_by: StoppedBy, outcome: Outcome) -> Episode:
    """Return an episode of that length."""
    seen = Observation(
        time_s=0.0, corner_positions=np.zeros((2, 3)), holder_position=np.zeros(3), word=np.zeros(2),
        word_strength=0.0, contact_portion=0.5,
    )  # fmt: skip
    truth = GroundTruth(nodes=np.zeros((4, 3)), contact_portion_true=0.5, flat_area=0.5)
    step = Step(observation=seen, ground_truth=truth, action=HANGER.zeros())
    return Episode(
        robot=HANGER, cloth="towel", seed=seed, source="keyboard", steps=(step,) * n_steps, final_observation=seen,
        final_ground_truth=truth, stopped_by=stopped_by, outcome=outcome,
    )  # fmt: skip


class FakeEpisode:
    """EpisodeHandle that counts steps, and saves an episode of that length."""

    def __init__(self, seed: int, recorder: SessionRecorder) -> None:
        self.seed = seed
        self.hangs = True
        self.dies_at: int | None = None
        self.stops: dict[int, StoppedBy] = {}
        """Reason to stop after a number of steps."""
        self.has_policy = False
        """Whether the person takes over from a policy; control returns only by `release_control`."""
        self.work: Callable[[], None] = lambda: None
        """Called in each step."""
        self.inputs: list[TeleopInput] = []
        self.disturbances: list[str] = []
        self.discarded = False
        self._recorder = recorder
        self._status = EpisodeStatus()

    def ready(self) -> bool:
        return self.hangs

    def status(self) -> EpisodeStatus:
        return self._status

    def step(self, teleop: TeleopInput, drag: DragTarget | None = None) -> EpisodeStatus:
        if len(self.inputs) == self.dies_at:
            raise EpisodeLost("the simulation was lost")
        self.inputs.append(teleop)
        self.work()
        n_steps = len(self.inputs)
        self._status = EpisodeStatus(
            n_steps=n_steps,
            time_s=0.1 * n_steps,
            contact_portion=min(0.01 * n_steps, 1.0),
            stopped_by=self.stops.get(n_steps),
            human_in_control=self.has_policy and (teleop.moving or self._status.human_in_control),
        )
        return self._status

    def disturb(self, name: str) -> None:
        self.disturbances.append(name)
        self._status = replace(self._status, disturbed=True)

    def release_control(self) -> None:
        self._status = replace(self._status, human_in_control=False)

    def save(self, outcome: Outcome, stopped_by: StoppedBy) -> SavedEpisode | None:
        if not self.inputs:
            return None
        return self._recorder.save(episode_of_zeros(len(self.inputs), self.seed, stopped_by, outcome))

    def discard(self) -> None:
        self.discarded = True


class Recording:
    """A RecordingSession over fake episodes, on a clock that the test moves."""

    def __init__(self, path: Path, **options) -> None:
        self.now = 0.0
        self.lines: list[str] = []
        self.episodes: list[FakeEpisode] = []
        self.recorder = SessionRecorder(path, robot=HANGER, cloth="towel")
        self.session = RecordingSession(
            self.recorder, self._make_episode, print_line=self.lines.append, clock=lambda: self.now, **options
        )

    def _make_episode(self, seed: int) -> FakeEpisode:
        self.episodes.append(FakeEpisode(seed, self.recorder))
        return self.episodes[-1]

    @property
    def state(self) -> str:
        return self.session.state

    def give(self, *commands: Command) -> None:
        self.session.handle_input(replace(AT_REST, commands=commands))

    def step(self, teleop: TeleopInput, n_steps: int = 1) -> int:
        """Return how many of so many steps with this input were simulated."""
        self.session.handle_input(teleop)
        return sum(self.session.step() for _ in range(n_steps))

    def begin(self, n_steps: int = 0) -> None:
        """Start, through the countdown, and move for so many steps."""
        self.give(Command.START)
        self.now += COUNTDOWN_S
        self.session.step()
        assert self.state == "running"
        self.step(FORWARD, n_steps)

    def close(self) -> None:
        self.session.close()
        self.recorder.close()


class FakeTeleoperator:
    """Teleoperator that returns what the test has set."""

    name = "keyboard"

    def __init__(self) -> None:
        self.motion = np.zeros(2)
        self.commands: list[Command] = []
        self.connected = True
        self.rumbles: list[float] = []
        self.on_poll: Callable[[], None] = lambda: None

    def poll(self) -> TeleopInput:
        self.on_poll()
        commands, self.commands = tuple(self.commands), []
        base = AT_REST if self.connected else DISCONNECTED
        motion = self.motion if self.connected else 0 * self.motion
        return replace(base, motion=motion, commands=commands, device="fake")

    def rumble(self, strength: float, seconds: float) -> None:
        self.rumbles.append(strength)

    def help(self) -> tuple[Button, ...]:
        return (Button("stick", "moves"),)

    def close(self) -> None: ...
