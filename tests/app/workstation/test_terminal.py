"""Recording in a terminal: when steps come, what is shown; the keyboard of a terminal."""

from __future__ import annotations

import io
import os
import signal

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from layflat.app.support.errors import LayflatError
from layflat.app.workstation.session.recording_session import COUNTDOWN_S
from layflat.app.workstation.teleop import key_map
from layflat.app.workstation.teleop.contact_rumble import TOUCHES, ContactRumble
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.app.workstation.teleop.teleoperator import Teleoperator
from layflat.app.workstation.teleop.terminal_keyboard import REPEAT_S, TAP_S, TerminalKeyboard
from layflat.app.workstation.teleop.terminal_keys import TerminalKeys, names_of
from layflat.app.workstation.terminal.display import (
    POLL_S,
    TerminalDisplay,
    introduce,
    run_recording,
    status_line,
    stops_on_signals,
)
from layflat.sim.robots.registry import ROBOTS, robot_spec
from layflat.tests.app.workstation.conftest import HandSource
from layflat.tests.app.workstation.test_recording import Desk

STEP_S = 0.1
SMALL_S = 1e-9


class Night:
    """Wall time that only passes where somebody works or sleeps."""

    def __init__(self, desk: Desk, source: HandSource, work_s: list[float]) -> None:
        self.desk, self.source = desk, source
        self.began: list[float] = []
        """When each step did."""
        self.until_s = 0.0
        take = desk.takes[0]

        def work() -> None:
            self.began.append(desk.now)
            desk.now += work_s[(len(self.began) - 1) % len(work_s)]

        take.work = work

    def sleep(self, seconds: float) -> None:
        assert seconds > 0
        self.desk.now += seconds

    def run(self, until_s: float):
        screen = TerminalDisplay(io.StringIO())
        return run_recording(
            self.desk.recording,
            self.source,
            screen,
            step_s=STEP_S,
            stopped=lambda: self.desk.now >= until_s,
            clock=lambda: self.desk.now,
            sleep=self.sleep,
        )


@pytest.fixture
def night(tmp_path_factory):
    """``night(work_s, ...)``: a recording past its countdown, with somebody who keeps moving."""
    desks: list[Desk] = []

    def make(work_s: list[float]) -> Night:
        desk = Desk(tmp_path_factory.mktemp("night") / "s.h5")
        desks.append(desk)
        desk.press(Command.START)
        desk.now += COUNTDOWN_S
        desk.recording.step()
        source = HandSource()
        source.motion = np.array([1.0, 0.0])
        return Night(desk, source, work_s)

    yield make
    for desk in desks:
        desk.press(Command.DISCARD)
        desk.close()


def test_a_machine_that_keeps_up_steps_in_real_time(night):
    one = night([0.03, 0.09, 0.05])
    rhythm = one.run(COUNTDOWN_S + 5.0).rhythm()
    assert np.diff(one.began) == pytest.approx(STEP_S, abs=POLL_S)
    assert len(one.began) == pytest.approx(50, abs=1)
    assert rhythm.n_steps == len(one.began) - 1
    assert rhythm.mean_s == pytest.approx(STEP_S, rel=0.01)
    assert rhythm.late == 0.0


def test_a_slow_machine_slows_the_motion_and_never_hurries(night):
    one = night([0.25] * 4 + [0.02] * 8)
    rhythm = one.run(COUNTDOWN_S + 10.0).rhythm()
    assert np.diff(one.began).min() >= STEP_S - POLL_S
    assert rhythm.worst_s == pytest.approx(0.25, abs=2 * POLL_S)
    assert rhythm.late > 0
    # Simulated time is what it always is.
    assert one.desk.recording.glance.time_s == pytest.approx(STEP_S * len(one.began))


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.floats(0.001, 0.3), min_size=1, max_size=5), st.floats(0.0, 3.0))
def test_from_input_to_motion_is_at_most_a_step_and_a_frame(night, work_s, at_s):
    one = night(work_s)
    moved_s = COUNTDOWN_S + at_s
    up = np.array([0.0, 1.0])

    def hand() -> None:
        if one.desk.now >= moved_s:
            one.source.motion = up

    one.source.on_poll = hand
    one.run(COUNTDOWN_S + 5.0)
    readings = one.desk.takes[0].readings
    first = next(k for k, reading in enumerate(readings) if reading.motion[1] > 0)
    # A step lasts as long as it is to last, or as the machine needs for it.
    step_s = max(STEP_S, *work_s)
    assert one.began[first] - moved_s <= step_s + POLL_S + SMALL_S
    assert all(reading.motion[1] > 0 for reading in readings[first:])


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.floats(0.001, 0.3), st.floats(0.2, 3.0))
def test_from_pause_to_standstill_is_at_most_a_step_and_a_frame(night, work_s, at_s):
    one = night([work_s])

    def hand() -> None:
        if one.desk.now >= COUNTDOWN_S + at_s and one.desk.state == "running":
            one.source.controls = [Command.PAUSE]

    one.source.on_poll = hand
    one.run(COUNTDOWN_S + 5.0)
    assert one.desk.state == "paused"
    assert one.began[-1] < COUNTDOWN_S + at_s


def test_a_pause_is_nobody_s_fault(night):
    one = night([0.02])
    for _ in range(2):
        one.run(one.desk.now + 1.0)
        one.desk.press(Command.PAUSE)
        one.desk.now += 30.0
        one.desk.press(Command.PAUSE)
    rhythm = one.run(one.desk.now + 1.0).rhythm()
    assert rhythm.worst_s <= STEP_S + POLL_S


def test_contact_is_felt_once_each_time_it_begins(hands):
    touch = ContactRumble(hands)
    for n_steps, contact in enumerate([0.0, 0.01, TOUCHES, 0.5, 0.3, 0.0, 0.4]):
        touch.see(contact, n_steps)
    assert len(hands.rumbles) == 2
    touch = ContactRumble(hands)
    for contact in (0.5, 0.5):  # The last demonstration's cloth.
        touch.see(contact, 0)
    touch.see(0.0, 0)
    assert len(hands.rumbles) == 2


def test_the_status_line_tells_state_numbers_and_what_can_be_done(tmp_path, hands):
    desk = Desk(tmp_path / "s.h5")
    line = status_line(desk.recording, hands.poll())
    assert "seed 0 hangs" in line
    assert "start" in line
    assert "keep" not in line
    desk.begin(n_steps=7)
    line = status_line(desk.recording, hands.poll())
    for word in ("RECORDING", "7 steps", "contact 7 %", "keep as success", "discard", "pause"):
        assert word in line
    desk.close()


def test_without_a_terminal_only_what_is_new_is_printed(tmp_path, hands):
    desk, stream = Desk(tmp_path / "s.h5"), io.StringIO()
    screen = TerminalDisplay(stream)
    desk.begin(n_steps=3)
    for _ in range(20):
        screen.show(desk.recording, hands.poll())
    assert stream.getvalue() == desk.recording.message + "\n"
    desk.close()


def test_help_comes_first(tmp_path, hands):
    desk, lines = Desk(tmp_path / "s.h5"), []
    introduce(desk.recording, hands, lines.append)
    assert lines == ["  stick  moves"]
    desk.close()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_are_noted_and_a_second_ctrl_c_interrupts(number):
    before = signal.getsignal(number)
    with stops_on_signals() as stopped:
        assert not stopped()
        os.kill(os.getpid(), number)
        assert stopped()
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(number) is before


class Typist:
    """A terminal's keyboard on a clock of its own."""

    def __init__(self, robot="hanger") -> None:
        self.now = 0.0
        self._typed: list[str] = []
        self.keyboard = TerminalKeyboard(robot, pressed=self._take, clock=lambda: self.now)

    def _take(self) -> list[str]:
        typed, self._typed = self._typed, []
        return typed

    def type(self, *names: str):
        self._typed += names
        return self.keyboard.poll()


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_terminal_s_keyboard_is_a_source(robot):
    keyboard = Typist(robot).keyboard
    assert isinstance(keyboard, Teleoperator)
    assert keyboard.poll().motion.shape == (robot_spec(robot).size,)
    assert {button.control for button in keyboard.help()} >= set(Command)


def test_a_tap_moves_for_a_while_and_then_stops():
    one = Typist()
    assert one.type("d").motion.tolist() == [1.0, 0.0]
    one.now = TAP_S - 0.01
    assert one.type().moving
    one.now = TAP_S + 0.01
    assert not one.type().moving


def test_a_held_key_moves_until_shortly_after_it_is_let_go():
    one = Typist()
    one.type("s")
    one.now = 0.5  # Terminals wait before they repeat.
    last = 0.5
    while last < 2.0:
        assert one.type("s").motion.tolist() == [0.0, -1.0]
        last, one.now = one.now, one.now + 0.033
    one.now = last + REPEAT_S + 0.04
    assert not one.type().moving


def test_the_opposite_key_turns_round_at_once():
    one = Typist()
    one.type("d")
    one.now = 0.05
    assert one.type("a").motion.tolist() == [-1.0, 0.0]
    assert one.type("w").motion.tolist() == [-1.0, 1.0]


def test_digits_set_the_speed_and_letters_the_controls():
    one = Typist()
    slow = one.type("2", "enter", "y")
    assert slow.speed == pytest.approx(0.2)
    assert slow.controls == (Command.START, Command.KEEP_SUCCESS)
    assert one.type().controls == ()
    assert one.type("0").speed == 1.0
    assert not one.type("%", "Q", "shift-up").controls


@pytest.mark.parametrize("robot", ROBOTS)
def test_every_key_does_one_thing_and_every_axis_has_a_key_each_way(robot):
    moves = key_map.key_motions(robot)
    assert not set(moves) & (set(key_map.CONTROLS) | set(key_map.SPEEDS))
    reach = np.array(list(moves.values()))
    assert (reach.max(axis=0) == 1).all()
    assert (reach.min(axis=0) == -1).all()
    assert set(key_map.CONTROLS.values()) == set(Command)


def test_a_sum_of_keys_stays_within_its_bounds():
    moves = key_map.key_motions("pickers")
    assert np.abs(key_map.sum_motions("pickers", moves, moves)).max() <= 1.0
    assert not key_map.sum_motions("pickers", moves, ["up", "down"]).any()


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
def test_names_of_what_a_terminal_sends(text, names):
    assert names_of(text) == names


@given(st.text(max_size=30))
def test_whatever_a_terminal_sends_is_names(text):
    assert all(name.isprintable() for name in names_of(text))


def test_without_a_terminal_it_says_what_works_instead(monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO())
    with pytest.raises(LayflatError, match="--source gamepad or scripted"):
        TerminalKeys()
