"""Sessions without a simulator or a device."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from layflat.app.workstation.session.episode import EpisodeHandle, EpisodeLost
from layflat.app.workstation.session.latest_value import LatestValue
from layflat.app.workstation.session.request import COUNTDOWN_S, SessionRequest
from layflat.app.workstation.session.session import Session
from layflat.app.workstation.session.status import EpisodeStatus, SessionEvent, SessionStatus, Verdict
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput, zero_input
from layflat.app.workstation.teleop.teleoperator import Button
from layflat.data.environment_spec import StepLimits
from layflat.data.session.recorder import SessionRecorder
from layflat.data.session.saved_episode import SavedEpisode
from layflat.data.types import DragTarget, Episode, GroundTruth, Observation, Outcome, Phase, Step, StoppedBy
from layflat.policy.spec import PolicySpec
from layflat.sim.config import SimConfig
from layflat.tests.factories import HANGER

AT_REST = zero_input(HANGER)
FORWARD = TeleopInput(motion=np.array([1.0, 0.0]))
DISCONNECTED = zero_input(HANGER, connected=False, problem="the gamepad was disconnected; plug it in again")


FLAT = Verdict(contact=0.99, flat_area=0.99, success=True, words="99 %, flat")
FOLDED = Verdict(contact=0.77, flat_area=0.82, success=False, words="77 %, folded over at the free edge")
STEP_S = 0.1
POLICY = "hold"


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


class FakeEpisode(EpisodeHandle):
    """EpisodeHandle that counts steps, each done ``work_s`` after it began, and saves an episode of that length."""

    def __init__(self, seed: int, recorder: SessionRecorder | None, clock: Callable[[], float]) -> None:
        self.seed, self.status, self.saved, self.ended = seed, None, None, False
        self.hangs = True
        self.dies_at: int | None = None
        self.stops: dict[int, StoppedBy] = {}
        """Reason why no step is taken after a number of steps."""
        self.has_policy = False
        """Whether the person takes over from a policy; control returns only by `release_control`."""
        self.limits = StepLimits()
        self.verdict = FLAT
        self.work_s: Callable[[], float] = lambda: 0.0
        self.inputs: list[TeleopInput] = []
        self.started_s: list[float] = []
        self.phases: list[str] = []
        self.disturbances: list[str] = []
        self.disturbed_steps = 0
        self.gone = self.holds = False
        """Whether it was discarded or killed, and whether nothing is done for now."""
        self.proceeded = self.shown = 0
        self._asked: list[tuple[float, Callable[[], bool]]] = []
        self._human = False
        self._recorder, self._clock = recorder, clock
        self._journal = None if recorder is None else recorder.new_journal()

    @property
    def busy(self) -> bool:
        return bool(self._asked) or self.status is None

    def poll(self) -> bool:
        if self.status is None and self.hangs:
            self.status = EpisodeStatus(limits=self.limits, policy=POLICY if self.has_policy else "")
        stepped = False
        while self._asked and self._asked[0][0] <= self._clock() and not self.holds:
            stepped = self._asked.pop(0)[1]() or stepped
        return stepped

    def ask(self, name: str, *details: object) -> None:
        getattr(self, name)(*details)

    def _ask(self, do: Callable[[], object], after_s: float = 0.0) -> None:
        assert not self.gone
        self._asked.append((self._clock() + after_s, lambda: do() is True))

    def step(self, phase: Phase, teleop: TeleopInput, drag: DragTarget | None) -> None:
        assert not self._asked, "a step began before the last one was done"
        self.started_s.append(self._clock())
        self._ask(lambda: self._step(phase, teleop), self.work_s())

    def _step(self, phase: Phase, teleop: TeleopInput) -> bool:
        if len(self.inputs) == self.dies_at:
            raise EpisodeLost("the simulation was lost")
        stop = self.stops.get(len(self.inputs)) if phase != "disturb" else None
        self._human = self.has_policy and (teleop.moving or self._human)
        if stop is None or self._human:
            stop = None
            self.inputs.append(teleop)
            self.phases.append(phase)
            self.disturbed_steps = max(self.disturbed_steps - 1, 0)
            if self.stops.get(len(self.inputs)) == "unstable":
                stop = "unstable"
        self._show(stop)
        return True

    def _show(self, stop: StoppedBy | None = None) -> None:
        n_steps = len(self.inputs)
        self.status = EpisodeStatus(
            steps=n_steps,
            time_s=0.1 * n_steps,
            contact=min(0.01 * n_steps, 1.0),
            verdict=self.verdict,
            stopped_by=stop,
            disturbed=self.disturbed_steps > 0,
            human_in_control=self._human,
            disturbances=tuple(self.disturbances),
            policy=POLICY if self.has_policy else "",
            limits=self.limits,
        )

    def disturb(self, name: str, repeat: int) -> None:
        assert repeat == len(self.disturbances)
        self.disturbances.append(name)
        self.disturbed_steps = 3
        self._ask(self._show)

    def release_control(self) -> None:
        self._human = False
        self._ask(self._show)

    def proceed(self) -> None:
        self.proceeded += 1

    def show(self) -> None:
        self.shown += 1

    def save(self, outcome: Outcome, stopped_by: StoppedBy) -> None:
        self._ask(lambda: self._save(outcome, stopped_by))

    def _save(self, outcome: Outcome, stopped_by: StoppedBy) -> None:
        if self.inputs and self._recorder is not None:
            episode = episode_of_zeros(len(self.inputs), self.seed, stopped_by, outcome)
            self.saved = self._recorder.save(episode, journal=self._journal)
        self.ended = self.gone = True

    def recover(self) -> SavedEpisode | None:
        if self._recorder is None or not self.inputs:
            self.gone = True
            return None
        self._save("partial", "crashed")
        return self.saved

    def discard(self) -> None:
        self.gone = True
        self._asked.clear()


class Recording:
    """A Session over fake episodes, on a clock that the test moves."""

    def __init__(self, path: Path | None, *, source: str = "keyboard", policy: bool = False, **options) -> None:
        self.now = 0.0
        self.events: list[SessionEvent] = []
        self.episodes: list[FakeEpisode] = []
        self.verdict = FLAT
        self.limits = StepLimits()
        self._has_policy = policy
        known = {item.name for item in fields(SessionRequest)} - {"seed"}
        request = SessionRequest(
            sim_config=SimConfig(robot="hanger"),
            source=source,
            session=path,
            policy=PolicySpec(builtin="hold") if policy else None,
            **{name: value for name, value in options.items() if name in known},
        )
        self.recorder = None if path is None else SessionRecorder(path, robot=HANGER, cloth="towel")
        self.session = Session(
            request,
            self._make_episode,
            emit=self.events.append,
            clock=lambda: self.now,
            **{name: value for name, value in options.items() if name not in known},
        )

    def _make_episode(self, seed: int) -> FakeEpisode:
        made = FakeEpisode(seed, self.recorder, lambda: self.now)
        made.has_policy, made.verdict, made.limits = self._has_policy, self.verdict, self.limits
        self.episodes.append(made)
        return made

    @property
    def lines(self) -> list[str]:
        return [event.text for event in self.events]

    @property
    def status(self) -> SessionStatus:
        return self.session.status()

    @property
    def state(self) -> str:
        return self.session.state

    @property
    def message(self) -> str:
        return self.status.message.text

    @property
    def n_steps(self) -> int:
        return self.status.steps

    @property
    def episode(self) -> FakeEpisode:
        """Newest episode."""
        return self.episodes[-1]

    def give(self, *commands: Command) -> None:
        for command in commands:
            self.session.handle_command(command)
        self.session.update()

    def step(self, teleop: TeleopInput, n_steps: int = 1, drag: DragTarget | None = None) -> int:
        """Return how many steps came of so many periods with this input."""
        before = sum(len(episode.inputs) for episode in self.episodes)
        self.session.handle_input(teleop, drag)
        for _ in range(n_steps):
            self.session.update()  # A step begins.
            self.session.update()  # It is done.
            self.now += STEP_S
        return sum(len(episode.inputs) for episode in self.episodes) - before

    def begin(self, n_steps: int = 0) -> None:
        """Start, through the countdown, and move for so many steps."""
        self.session.handle_input(AT_REST)
        self.session.update()
        self.give(Command.START)
        self.now += COUNTDOWN_S
        self.session.update()
        assert self.state in ("still", "running")
        self.step(FORWARD, n_steps)

    def close(self) -> None:
        self.session.close()
        for _ in range(10):
            self.now += 1.0
            self.session.update()
        assert self.session.done
        if self.recorder is not None:
            self.recorder.close()


class FakeClient:
    """SessionClient whose session runs in this process, on the test's clock."""

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self.status = recording.status
        self.frame = None
        self._n_events = 0

    @property
    def alive(self) -> bool:
        return not self.recording.session.done

    def send_command(self, command: Command) -> None:
        self.recording.session.handle_command(command)

    def send_input(self, teleop: TeleopInput) -> None:
        self.recording.session.handle_input(teleop)

    def poll(self) -> list[SessionEvent]:
        self.recording.session.update()
        self.status = self.recording.status
        new, self._n_events = self.recording.events[self._n_events :], len(self.recording.events)
        return new

    def end(self) -> list[SessionEvent]:
        return []


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


WIDE = 20_000
"""Numbers of a value that takes longer to copy than a process may run at a time."""


def write_for(value: LatestValue, seconds: float) -> None:
    """Write values one after another, each of one number; for a process of its own."""
    number, end = 0, time.monotonic() + seconds
    while time.monotonic() < end:
        number += 1
        value.write(np.full(WIDE, number))
