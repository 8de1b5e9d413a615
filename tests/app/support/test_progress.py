"""Progress says what is done and how long the rest takes, sparingly where there is no terminal."""

from __future__ import annotations

import io
import re
from itertools import pairwise

import numpy as np
import pytest

from layflat.app.support.progress import Progress, duration


class Clock:
    """A clock that the test advances."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def test_plain_lines_are_few_but_come_with_each_item():
    clock, stream = Clock(), io.StringIO()
    with Progress({"work": 100}, stream=stream, clock=clock, interval_s=5) as progress:
        progress.phase("work", items=4)
        for _ in range(4):
            for _ in range(100):  # 10 s of steps an item
                clock.now += 0.1
                progress.status("step")
            progress.advance()
    lines = stream.getvalue().splitlines()
    assert sum("4/4" in line for line in lines) == 1
    assert all(any(f"{k}/4" in line for line in lines) for k in range(5))
    assert len(lines) == 1 + 4 + 1
    assert lines[-1] == "[100 %] done (in 40 s)"
    assert "\x1b" not in stream.getvalue()


def test_remaining_time_follows_the_weights_then_the_measured_speed():
    clock = Clock()
    with Progress({"a": 30, "b": 70}, stream=io.StringIO(), clock=clock) as progress:
        progress.phase("a", items=3)
        assert progress.remaining_s() == pytest.approx(100)
        for _ in range(3):  # twice as slow as expected
            clock.now += 20
            progress.advance()
        assert progress.remaining_s() == pytest.approx(140, rel=0.05)
        progress.phase("b")
        assert progress.share == pytest.approx(0.3)
        left_s = progress.remaining_s()
        clock.now += 10
        assert progress.remaining_s() == pytest.approx(left_s - 10)


@pytest.mark.parametrize("slowness", [0.4, 1.0, 3.0, 8.0])
def test_the_time_left_does_not_jump_and_is_right_after_a_quarter(slowness):
    """Steps of 0.1 s after a silent start, at a speed that was not expected."""
    clock, total_s, found = Clock(), 100.0 * slowness, {}
    with Progress({"episodes": 90, "report": 10}, stream=io.StringIO(), clock=clock) as progress:
        for phase, seconds in (("episodes", 90 * slowness), ("report", 10 * slowness)):
            progress.phase(phase)
            for step in range(1, 1 + int(seconds * 10)):
                clock.now += 0.1
                progress.within(0.1 * step / seconds)
                found[clock.now] = clock.now + progress.remaining_s()
    ends = list(found.values())
    assert all(abs(b - a) < 0.08 * max(total_s, 100) for a, b in pairwise(ends))
    late = [end for now_s, end in found.items() if now_s >= 0.25 * total_s]
    assert all(0.75 * total_s < end < 1.3 * total_s for end in late)


def test_what_was_there_already_says_nothing_about_the_speed():
    clock = Clock()
    with Progress({"a": 50, "b": 50, "c": 50}, stream=io.StringIO(), clock=clock) as progress:
        progress.phase("a", items=10)  # nothing to do: closed at once
        progress.phase("b", items=10)
        progress.skip(5, "already there")
        assert progress.share == pytest.approx(0.5)
        assert progress.remaining_s() == pytest.approx(75)
        for k in range(1, 6):
            clock.now += 5
            progress.advance(share=k / 5)
        assert progress.share == pytest.approx(2 / 3)
        assert progress.remaining_s() == pytest.approx(50)


def test_a_future_that_says_nothing_moves_the_bar_by_its_expected_time():
    clock, shares = Clock(), []

    class Slow:
        """Comes after ten waits of 1 s."""

        left = 10

        def done(self) -> bool:
            return False

        def result(self, timeout=None):
            shares.append(progress.share)
            clock.now += 1
            self.left -= 1
            if self.left:
                raise TimeoutError
            return "model"

    with Progress({"training": 10}, stream=io.StringIO(), clock=clock) as progress:
        progress.phase("training", items=2)
        assert progress.wait(Slow()) == "model"
        assert (np.diff(shares) > 0).all()
        assert 0.3 < shares[-1] < 0.5
        progress.advance()
        assert progress.share == 0.5


def test_share_never_falls_and_ends_at_one():
    progress = Progress({"a": 1, "b": 2}, stream=io.StringIO())
    shares = []
    with progress:
        for name in ("a", "b"):
            progress.phase(name, items=5)
            for _ in range(7):  # more than announced must not overshoot
                progress.advance()
                shares.append(progress.share)
    assert shares == sorted(shares)
    assert progress.share == 1.0


def test_a_phase_that_is_left_out_does_not_matter_but_an_unknown_one_is_refused():
    with Progress({"a": 1}, stream=io.StringIO()) as progress, pytest.raises(ValueError, match="known ones are a"):
        progress.phase("b")


def test_phases_need_weights():
    with pytest.raises(ValueError, match="above 0"):
        Progress({"a": 0.0})


def test_notes_are_kept_as_they_are():
    stream = io.StringIO()
    with Progress({"a": 1}, stream=stream) as progress:
        progress.note("kept demo_3 [success]")
    assert stream.getvalue().startswith("kept demo_3 [success]\n")


def test_terminal_gets_a_bar_with_what_is_done_now():
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    stream = Terminal()
    with Progress({"training": 5}, stream=stream) as progress:
        progress.phase("training", items=2)
        progress.advance(status="dx [mm]")
    assert re.search(r"training 1/2: dx \[mm\]", stream.getvalue())


@pytest.mark.parametrize(("seconds", "text"), [(0, "0 s"), (89, "89 s"), (120, "2 min"), (3900, "1 h 05 min")])
def test_durations_read_well(seconds, text):
    assert duration(seconds) == text
