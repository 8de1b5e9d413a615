"""SessionClient and its process with the real simulation: what arrives, how soon, and what is kept when it dies."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest

from layflat.app.support.errors import UsageError
from layflat.app.workstation.session.client import SessionClient
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.session.status import SessionEvent
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput, zero_input
from layflat.data.session.reader import open_session
from layflat.data.session.recorder import SessionRecorder
from layflat.policy.spec import PolicySpec
from layflat.sim.config import SimConfig
from layflat.tests.factories import HANGER, PICKERS

NAPKIN = SimConfig(robot="hanger", cloth="napkin")
REST = zero_input(HANGER)
DOWN = TeleopInput(motion=np.array([0.0, -1.0]), speed=0.5)


class Person:
    """Holds a stick, and looks at the status."""

    def __init__(self, client: SessionClient) -> None:
        self.client, self.teleop = client, REST
        self.events: list[SessionEvent] = []

    def until(self, condition: Callable[[], object], seconds: float = 60.0) -> None:
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, f"waited {seconds} s: {self.client.status} {self.client.problem}"
            self.events += self.client.poll()
            self.client.send_input(self.teleop)
            time.sleep(0.005)

    def start(self, path: Path | None, **options) -> None:
        options = {"source": "keyboard", "countdown_s": 0.1} | options
        self.client.start(SessionRequest(sim_config=NAPKIN, session=path, **options))
        self.until(lambda: self.client.status.ready or not self.client.alive)

    def move(self, n_steps: int = 5) -> None:
        """Begin a take, and move for so many steps at least."""
        self.client.send_command(Command.START)
        self.until(lambda: self.client.status.state == "still")
        self.teleop = DOWN
        self.until(lambda: self.client.status.steps >= n_steps)
        self.teleop = REST

    def give(self, command: Command) -> None:
        self.client.send_command(command)


@pytest.fixture
def person() -> Iterator[Person]:
    made = Person(SessionClient())
    yield made
    made.client.end()


def outcomes(path: Path) -> list[tuple[str, int]]:
    with open_session(path) as session:
        return [(info.outcome, info.seed) for info in session.infos().values()]


def test_a_take_is_judged_discarded_brought_back_and_kept(person, tmp_path):
    path, client = tmp_path / "s.h5", person.client
    person.start(path, episodes=1, speed=4.0)
    assert client.status.message.text == "seed 0 hangs"
    person.move(10)
    shown = client.frame.nodes
    person.give(Command.KEEP_SUCCESS)
    person.until(lambda: client.status.question)
    assert client.status.question.endswith("in the air: keep as success?")
    person.give(Command.DISCARD)
    person.until(lambda: client.status.discarded and client.status.ready and not np.allclose(client.frame.nodes, shown))
    person.give(Command.UNDO)
    person.until(lambda: client.status.state == "paused" and client.frame.step >= 10)
    person.give(Command.KEEP_FAILURE)
    person.until(lambda: not client.alive)
    client.check()
    assert [event.kind for event in person.events] == ["kept"]
    assert outcomes(path) == [("failure", 0)]
    assert [file.name for file in tmp_path.iterdir()] == ["s.h5"]


def test_an_input_acts_in_the_next_step(person, tmp_path):
    """From writing an input to the frame of the step that it acts in, at most two steps pass."""
    person.start(None)
    person.move(3)
    delays = []
    for _ in range(12):
        before = person.client.frame.step
        stamp_s = person.client.send_input(DOWN)
        while person.client.frame.input_s < stamp_s:
            assert time.monotonic() - stamp_s < 5.0
            person.client.poll()
            time.sleep(0.001)
        delays.append(person.client.frame.step - before)
        time.sleep(0.037)
    # The step under way, and the one after it.
    assert max(delays) <= 2


@pytest.mark.parametrize("how", ["end", "SIGTERM", "client"])
def test_an_end_keeps_the_running_take_as_partial(person, tmp_path, how):
    path = tmp_path / "s.h5"
    person.start(path, speed=4.0)
    person.move()
    process = psutil.Process(person.client.pid)
    if how == "end":
        assert [event.text.split()[2] for event in person.client.end()] == ["partial"]
    elif how == "SIGTERM":
        process.terminate()
        person.until(lambda: not person.client.alive)
    else:
        person.client._connection.close()  # As of a client that was killed.
        end = time.monotonic() + 20.0
        while process.is_running() and process.status() != psutil.STATUS_ZOMBIE:
            assert time.monotonic() < end
            time.sleep(0.01)
        person.client._connection = None
        person.client._process = None
    assert outcomes(path) == [("partial", 0)]
    assert person.client.problem == ""
    assert [file.name for file in tmp_path.iterdir()] == ["s.h5"]


def test_a_session_that_is_killed_is_reported_and_loses_nothing(person, tmp_path):
    path = tmp_path / "s.h5"
    person.start(path, speed=4.0)
    person.move()
    person.give(Command.KEEP_FAILURE)
    person.until(lambda: person.events)
    person.move()
    time.sleep(1.0)  # The journal is flushed twice a second.
    os.kill(person.client.pid, signal.SIGKILL)
    person.until(lambda: not person.client.alive)
    assert "SIGKILL" in person.client.problem
    assert "kept episodes are safe" in person.client.problem
    person.start(path)
    assert person.client.problem == ""
    assert "an earlier recording was interrupted" in person.client.status.message.text
    person.client.end()
    assert outcomes(path) == [("failure", 0), ("partial", 1)]


def test_a_file_of_another_robot_is_a_wrong_call(person, tmp_path, make_episode):
    path = tmp_path / "s.h5"
    with SessionRecorder(path, robot=PICKERS, cloth="napkin"):
        pass
    with SessionRecorder(path, robot=HANGER, cloth="towel") as recorder:
        recorder.save(make_episode(cloth="towel", disturbed=False))
    person.start(path)
    with pytest.raises(UsageError, match="cloth towel, not napkin"):
        person.client.check()


def test_a_policy_of_another_task_is_one_sentence(person):
    person.start(None, policy=PolicySpec(builtin="word"), source="")
    person.until(lambda: not person.client.alive)
    assert "word" in person.client.problem
    assert "internal error" not in person.client.problem


def test_a_new_session_ends_the_one_before(person):
    person.start(None)
    first = psutil.Process(person.client.pid)
    person.start(None)
    assert not first.is_running()


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["place", "correct", "smooth"])
def test_a_policy_lays_the_cloth_and_is_disturbed(person, tmp_path, mode):
    path, client = tmp_path / "s.h5", person.client
    config = SimConfig(robot="pickers", task="smooth") if mode == "smooth" else SimConfig(robot="hanger")
    policy = PolicySpec(builtin="word" if mode == "smooth" else "scripted")
    source = "keyboard" if mode == "correct" else ""
    client.start(SessionRequest(sim_config=config, session=path, policy=policy, source=source, fast_forward=True))
    person.teleop = zero_input(config.robot_spec)
    if mode == "correct":
        client.send_command(Command.START)
    person.until(lambda: client.status.state == "stopped", 120.0)
    assert client.status.verdict is not None
    assert client.status.message.level == ("success" if client.status.verdict.success else "warning")
    if mode == "place":
        client.disturb("push")
        person.until(lambda: client.status.phase == "repair" and client.status.state == "stopped", 120.0)
        assert client.status.disturbances == ("push",)
    if mode == "correct":
        person.teleop = DOWN
        person.until(lambda: client.status.controller == "you")
        person.teleop = REST
        person.until(lambda: client.status.state == "stopped", 120.0)
        assert client.status.intervention_steps > 0
    success = client.status.verdict.success
    person.give(Command.KEEP_SUCCESS if success else Command.KEEP_FAILURE)
    person.until(lambda: person.events)
    client.end()
    assert outcomes(path)[0][0] == ("success" if success else "failure")
    with open_session(path) as session:
        phases = {step.phase for step in session[0].steps}
    assert phases == ({"place", "disturb", "repair"} if mode == "place" else {"place"})
