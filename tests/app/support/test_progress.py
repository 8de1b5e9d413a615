"""Progress says what is done and how long the rest takes, sparingly where there is no terminal."""

from __future__ import annotations

import io
import re

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
    assert len(lines) <= 1 + 4 + 40 / 5
    assert "\x1b" not in stream.getvalue()


def test_remaining_time_follows_the_weights_then_the_measured_speed():
    clock = Clock()
    with Progress({"a": 30, "b": 70}, stream=io.StringIO(), clock=clock) as progress:
        progress.phase("a", items=3)
        assert progress.remaining_s() == pytest.approx(100)
        for _ in range(3):  # twice as slow as expected
            clock.now += 20
            progress.advance()
        assert progress.remaining_s() == pytest.approx(140)
        progress.phase("b")
        assert progress.share == pytest.approx(0.3)
        assert progress.remaining_s() == pytest.approx(140)


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
    assert stream.getvalue() == "kept demo_3 [success]\n"


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
