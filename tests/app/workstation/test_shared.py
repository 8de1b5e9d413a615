"""Values in shared memory, the mailbox, and the cadence."""

from __future__ import annotations

import multiprocessing
import time

import numpy as np
import pytest

from layflat.app.workstation.session.input_channel import InputChannel
from layflat.app.workstation.session.latest_value import LatestValue
from layflat.app.workstation.session.rate_limiter import RateLimiter
from layflat.app.workstation.teleop import TeleopInput
from layflat.data.types import DragTarget

CONTEXT = multiprocessing.get_context("forkserver")
WIDE = np.dtype([("number", "i8"), ("filling", "i8", 20_000)])
"""Large enough that copying it takes longer than a process is let run at a time."""


def write_for(value: LatestValue, seconds: float) -> None:
    number, give_up = 0, time.monotonic() + seconds
    while time.monotonic() < give_up:
        number += 1
        value.write(number=number, filling=np.full(20_000, number))


def test_no_value_is_ever_half_of_one_and_half_of_another():
    value = LatestValue(CONTEXT, WIDE)
    writer = CONTEXT.Process(target=write_for, args=(value, 1.5))
    writer.start()
    seen, newest = 0, 0
    while writer.is_alive():
        found = value.read(newest)
        if found is None:
            continue
        number, one = found
        assert number > newest
        assert (one["filling"] == one["number"]).all()
        newest, seen = number, seen + 1
    writer.join()
    assert writer.exitcode == 0
    assert seen > 20


def test_only_what_is_newer_is_read():
    value = LatestValue(CONTEXT, np.dtype([("a", "f8")]))
    assert value.read() is None
    value.write(a=1.0)
    value.write(a=2.0)
    number, one = value.read()
    assert (number, float(one["a"])) == (2, 2.0)
    assert value.read(number) is None


@pytest.mark.parametrize("robot", ["hanger", "pickers"])
@pytest.mark.parametrize("hand", [None, (3,), (2, 3)])
def test_a_letter_says_what_was_put_in(robot, hand):
    rng = np.random.default_rng(1)
    reading = TeleopInput(
        motion=rng.uniform(-1, 1, 2 if robot == "hanger" else 6),
        speed=0.25,
        connected=False,
        device="Pad é",
        problem="it is gone",
        hand=None if hand is None else rng.normal(size=hand),
    )
    mailbox = InputChannel(CONTEXT, robot)
    assert mailbox.look() is None
    before = time.monotonic()
    stamp = mailbox.put(reading, DragTarget(node=7, target_m=[0.1, 0.2, 0.3]))
    letter = mailbox.look()
    assert before <= stamp == letter.stamp_s == letter.reading.stamp_s <= time.monotonic()
    np.testing.assert_array_equal(letter.reading.motion, reading.motion)
    assert (letter.reading.speed, letter.reading.connected) == (0.25, False)
    assert (letter.reading.device, letter.reading.problem) == ("Pad é", "it is gone")
    if hand is None:
        assert letter.reading.hand is None
    else:
        np.testing.assert_array_equal(letter.reading.hand, reading.hand)
    assert letter.pull.node == 7
    np.testing.assert_array_equal(letter.pull.target_m, [0.1, 0.2, 0.3])
    mailbox.put(reading)
    assert mailbox.look().pull is None


class Clock:
    """A wall clock that only moves when something takes time."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


def steps_of(works: list[float], *, speed: float = 1.0) -> tuple[list[float], RateLimiter]:
    """When each step began, on a machine that needs ``works`` for them."""
    clock = Clock()
    cadence = RateLimiter(0.1, speed, clock=clock, sleep=clock.sleep)
    began = []
    for work in works:
        cadence.begin()
        began.append(clock.now)
        clock.now += work
        cadence.end()
    return began, cadence


def test_a_machine_that_keeps_up_steps_evenly():
    began, cadence = steps_of([0.03, 0.08, 0.01, 0.09, 0.05])
    np.testing.assert_allclose(np.diff(began), 0.1)
    rhythm = cadence.rhythm()
    assert (rhythm.mean_s, rhythm.late) == (pytest.approx(0.1), 0.0)
    assert rhythm.factor(0.1) == pytest.approx(1.0)
    assert rhythm.work_s == pytest.approx(0.052)


def test_what_is_late_is_not_made_up_for():
    """Hurrying after a slow step would make the motion jump under the person's hands."""
    began, cadence = steps_of([0.02, 0.35, 0.02, 0.02, 0.02])
    lengths = np.diff(began)
    np.testing.assert_allclose(lengths, [0.1, 0.35, 0.1, 0.1])
    assert cadence.rhythm().worst_s == pytest.approx(0.35)
    assert cadence.rhythm().late == pytest.approx(1 / 4)


def test_a_slow_machine_slows_time():
    began, cadence = steps_of([0.25] * 6)
    np.testing.assert_allclose(np.diff(began), 0.25)
    assert cadence.rhythm().factor(0.1) == pytest.approx(0.4)


def test_twice_the_speed_is_half_the_wait():
    began, _ = steps_of([0.01] * 5, speed=2.0)
    np.testing.assert_allclose(np.diff(began), 0.05)


def test_a_pause_is_nobodys_fault():
    clock = Clock()
    cadence = RateLimiter(0.1, clock=clock, sleep=clock.sleep)
    for _ in range(3):
        cadence.begin()
        cadence.end()
    cadence.pause()
    clock.now += 60.0
    cadence.begin()
    assert cadence.rhythm().worst_s == pytest.approx(0.1)
