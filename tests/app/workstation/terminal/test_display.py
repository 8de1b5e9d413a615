"""Recording in a terminal: when steps come and what is shown; the keyboard of a terminal."""

from __future__ import annotations

import io
import os
import signal

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from layflat.app.support.errors import LayflatError
from layflat.app.workstation.session.request import COUNTDOWN_S
from layflat.app.workstation.session.status import SessionStatus
from layflat.app.workstation.stop_signals import stop_on_signals
from layflat.app.workstation.teleop import keyboard
from layflat.app.workstation.teleop.contact_rumble import CONTACT_MIN, ContactRumble
from layflat.app.workstation.teleop.keyboard import REPEAT_S, TAP_S, TerminalKeyboard
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.app.workstation.teleop.teleoperator import Teleoperator
from layflat.app.workstation.teleop.terminal_keys import TerminalKeys, key_names
from layflat.app.workstation.terminal.display import (
    POLL_S,
    TerminalDisplay,
    print_instructions,
    run_recording,
)
from layflat.app.workstation.terminal.panel import status_line
from layflat.tests.app.workstation.fakes import FakeClient, FakeTeleoperator, Recording
from layflat.tests.factories import HANGER, PICKERS, ROBOT_SPECS

STEP_S = 0.1
SMALL_S = 1e-9


class Clocked:
    """A recording past its countdown, of a person who keeps moving, on a clock that only sleep moves."""

    def __init__(self, recording: Recording, work_s: list[float]) -> None:
        self.recording, self.teleoperator = recording, FakeTeleoperator()
        self.teleoperator.motion = np.array([1.0, 0.0])
        recording.begin()
        recording.episode.work_s = lambda: work_s[len(self.started) % len(work_s)]

    @property
    def started(self) -> list[float]:
        """Start of each step."""
        return self.recording.episodes[0].started_s

    def sleep(self, seconds: float) -> None:
        assert seconds > 0
        self.recording.now += seconds

    def run(self, until_s: float) -> SessionStatus:
        one = self.recording
        run_recording(
            FakeClient(one), self.teleoperator, TerminalDisplay(io.StringIO()),
            stopped=lambda: one.now >= until_s, sleep=self.sleep,
        )  # fmt: skip
        return one.status


@pytest.fixture
def clocked(tmp_path_factory):
    """``clocked(work_s)``: steps take so long, in turn."""
    made: list[Recording] = []

    def make(work_s: list[float]) -> Clocked:
        made.append(Recording(tmp_path_factory.mktemp("clocked") / "s.h5"))
        return Clocked(made[-1], work_s)

    yield make
    for recording in made:
        recording.close()


def test_a_machine_that_keeps_up_steps_in_real_time(clocked):
    one = clocked([0.03, 0.09, 0.05])
    status = one.run(COUNTDOWN_S + 5.0)
    assert np.diff(one.started) == pytest.approx(STEP_S, abs=POLL_S + SMALL_S)
    assert len(one.started) == pytest.approx(50, abs=1)
    assert status.real_time_factor == pytest.approx(1.0, rel=0.01)


def test_a_slow_machine_slows_the_motion_and_never_hurries(clocked):
    one = clocked([0.25] * 4 + [0.02] * 8)
    status = one.run(COUNTDOWN_S + 10.0)
    assert np.diff(one.started).min() >= STEP_S - POLL_S - SMALL_S
    assert np.diff(one.started).max() == pytest.approx(0.25, abs=2 * POLL_S)
    assert "0 % late" not in status.timing
    # Simulated time is what it always is.
    assert status.time_s == pytest.approx(STEP_S * len(one.started), abs=1.01 * STEP_S)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.floats(0.001, 0.3), min_size=1, max_size=5), st.floats(0.0, 3.0))
def test_an_input_moves_the_cloth_within_a_step_and_a_poll(clocked, work_s, at_s):
    one = clocked(work_s)
    moved_s = COUNTDOWN_S + at_s
    up = np.array([0.0, 1.0])

    def person() -> None:
        if one.recording.now >= moved_s:
            one.teleoperator.motion = up

    one.teleoperator.on_poll = person
    one.run(COUNTDOWN_S + 5.0)
    inputs = one.recording.episodes[0].inputs
    first = next(k for k, teleop in enumerate(inputs) if teleop.motion[1] > 0)
    # A step takes its time, or the time that the machine needs for it.
    step_s = max(STEP_S, *work_s)
    assert one.started[first] - moved_s <= step_s + POLL_S + SMALL_S
    assert all(teleop.motion[1] > 0 for teleop in inputs[first:])


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.floats(0.001, 0.3), st.floats(0.2, 3.0))
def test_a_pause_stops_time_within_a_step_and_a_poll(clocked, work_s, at_s):
    one = clocked([work_s])

    def person() -> None:
        if one.recording.now >= COUNTDOWN_S + at_s and one.recording.state == "running":
            one.teleoperator.commands = [Command.PAUSE]

    one.teleoperator.on_poll = person
    one.run(COUNTDOWN_S + 5.0)
    assert one.recording.state == "paused"
    assert one.started[-1] < COUNTDOWN_S + at_s


def test_a_pause_does_not_count_as_late(clocked):
    one = clocked([0.02])
    for _ in range(2):
        one.run(one.recording.now + 1.0)
        one.recording.give(Command.PAUSE)
        one.recording.now += 30.0
        one.recording.give(Command.PAUSE)
    status = one.run(one.recording.now + 1.0)
    assert status.real_time_factor == pytest.approx(1.0, rel=0.1)


def test_contact_rumbles_once_each_time_it_begins(teleoperator):
    rumble = ContactRumble(teleoperator)
    for n_steps, contact in enumerate([0.0, 0.01, CONTACT_MIN, 0.5, 0.3, 0.0, 0.4]):
        rumble.update(contact, n_steps)
    assert len(teleoperator.rumbles) == 2
    rumble = ContactRumble(teleoperator)
    for contact in (0.5, 0.5):  # The cloth of the last demonstration.
        rumble.update(contact, 0)
    rumble.update(0.0, 0)
    assert len(teleoperator.rumbles) == 2


def test_the_status_line_has_state_numbers_and_available_commands(record, teleoperator):
    one = record()
    one.session.update()
    line = status_line(one.status, teleoperator.poll(), keyboard.key_help(HANGER))
    assert "seed 0 hangs" in line
    assert "start" in line
    assert "keep" not in line
    one.begin(n_steps=7)
    line = status_line(one.status, teleoperator.poll(), keyboard.key_help(HANGER))
    for word in ("RECORDING", "7 steps", "contact 7 %", "keep as success", "discard", "pause"):
        assert word in line


def test_without_a_terminal_only_new_messages_are_printed(record, teleoperator):
    one, stream, lines = record(), io.StringIO(), []
    print_instructions(teleoperator, lines.append)
    assert lines == ["  stick  moves"]
    display = TerminalDisplay(stream)
    one.begin(n_steps=3)
    for _ in range(20):
        display.show(one.status, teleoperator.poll())
    assert stream.getvalue() == one.message + "\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_are_noted_and_a_second_ctrl_c_interrupts(number):
    before = signal.getsignal(number)
    with stop_on_signals() as stopped:
        assert not stopped()
        os.kill(os.getpid(), number)
        assert stopped()
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(number) is before


class Typist:
    """Types on a terminal's keyboard, on a clock of its own."""

    def __init__(self, robot=HANGER) -> None:
        self.now = 0.0
        self._typed: list[str] = []
        self.keyboard = TerminalKeyboard(robot, pressed=self._take, clock=lambda: self.now)

    def _take(self) -> list[str]:
        typed, self._typed = self._typed, []
        return typed

    def type(self, *names: str):
        self._typed += names
        return self.keyboard.poll()


@pytest.mark.parametrize("robot", ROBOT_SPECS, ids=str)
def test_the_terminals_keyboard_is_a_teleoperator(robot):
    keyboard = Typist(robot).keyboard
    assert isinstance(keyboard, Teleoperator)
    assert keyboard.poll().motion.shape == (robot.size,)
    assert {button.command for button in keyboard.help()} >= set(Command)


def test_a_tap_moves_for_a_while_and_then_stops():
    one = Typist()
    assert one.type("d").motion.tolist() == [1.0, 0.0]
    one.now = TAP_S - 0.01
    assert one.type().moving
    one.now = TAP_S + 0.01
    assert not one.type().moving


def test_a_held_key_moves_until_shortly_after_it_is_released():
    one = Typist()
    one.type("s")
    one.now = 0.5  # Terminals wait before they repeat.
    last = 0.5
    while last < 2.0:
        assert one.type("s").motion.tolist() == [0.0, -1.0]
        last, one.now = one.now, one.now + 0.033
    one.now = last + REPEAT_S + 0.04
    assert not one.type().moving


def test_the_opposite_key_reverses_at_once():
    one = Typist()
    one.type("d")
    one.now = 0.05
    assert one.type("a").motion.tolist() == [-1.0, 0.0]
    assert one.type("w").motion.tolist() == [-1.0, 1.0]


def test_digits_set_the_speed_and_letters_give_commands():
    one = Typist()
    slow = one.type("2", "enter", "y")
    assert slow.speed == pytest.approx(0.2)
    assert slow.commands == (Command.START, Command.KEEP_SUCCESS)
    assert one.type().commands == ()
    assert one.type("0").speed == 1.0
    assert not one.type("%", "Q", "shift-up").commands


@pytest.mark.parametrize("robot", ROBOT_SPECS, ids=str)
def test_every_key_does_one_thing_and_every_axis_has_a_key_each_way(robot):
    moves = keyboard.key_motions(robot)
    assert not set(moves) & (set(keyboard.COMMANDS) | set(keyboard.SPEEDS))
    reach = np.array(list(moves.values()))
    assert (reach.max(axis=0) == 1).all()
    assert (reach.min(axis=0) == -1).all()
    assert set(keyboard.COMMANDS.values()) == set(Command)


def test_a_sum_of_keys_stays_within_its_bounds():
    moves = keyboard.key_motions(PICKERS)
    everything = keyboard.TerminalKeyboard(PICKERS, pressed=lambda: list(moves)).poll()
    assert np.abs(everything.motion).max() <= 1.0


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("a", ["a"]),
        ("\r \n", ["enter", "space", "enter"]),
        ("\x1b[A\x1bOB", ["up", "down"]),
        ("\x1b[1;2D\x1b[1;2C", ["shift-left", "shift-right"]),
        ("\x1b[15~y", ["y"]),  # F5 is nothing, and does not become other keys.
        ("\x1b[200~", []),
        ("\x1b", []),
        ("\x1b[", []),
        ("\x01\x7f", []),
        ("ä", ["ä"]),
    ],
)
def test_keys_are_named_by_what_a_terminal_sends(text, names):
    assert key_names(text) == names


@given(st.text(max_size=30))
def test_any_text_of_a_terminal_is_named(text):
    assert all(name.isprintable() for name in key_names(text))


def test_without_a_terminal_the_error_says_what_works_instead(monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO())
    with pytest.raises(LayflatError, match="--source gamepad or scripted"):
        TerminalKeys()
