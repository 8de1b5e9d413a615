"""The window's link to the bench's process: what arrives, how soon, and what is said when the bench dies."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest

from layflat.app.workstation.session.bench_client import BenchClient
from layflat.app.workstation.teleop.teleop_input import zero_input
from layflat.tests.app.workstation.fake_work import STEP_S, FakeWork


@pytest.fixture
def link() -> Iterator[BenchClient]:
    made = BenchClient(FakeWork)
    yield made
    made.end()


def hear_until(link: BenchClient, what, seconds: float = 60.0) -> list[dict]:
    """Messages until ``what()`` holds."""
    heard, give_up = [], time.monotonic() + seconds
    while not what():
        assert time.monotonic() < give_up, f"waited {seconds} s: {link.status} {link.sentence}"
        heard += link.hear()
        time.sleep(0.005)
    return heard


def test_an_input_acts_in_the_next_step(link):
    """Put in at any moment between two steps, it is what the next step acts on, and no later one is needed."""
    link.start({}, "hanger")
    hear_until(link, lambda: link.status.get("steps"))
    rng = np.random.default_rng(0)
    stamps = []
    for _ in range(25):
        time.sleep(float(rng.uniform(0.2, 1.8)) * STEP_S)
        # It is there when `put` returns, which a busy machine may keep waiting after the stamp.
        stamps.append((link.put(zero_input("hanger")), time.monotonic()))
    hear_until(link, lambda: link.status["steps"][-1][1] >= stamps[-1][0])
    n_steps = link.status["steps"]
    late = []
    for stamp, there in stamps:
        began, acted_on = next((began, acted) for began, acted in n_steps if began > there)
        assert acted_on >= stamp
        late.append(began - stamp)
    # A step waits for nobody: what it had to wait for is the rest of the step before.
    assert np.median(late) <= STEP_S


def test_a_bench_that_dies_becomes_a_sentence_and_can_be_started_again(link):
    link.start({}, "hanger")
    hear_until(link, lambda: link.status.get("steps"))
    link.ask("die")
    hear_until(link, lambda: not link.alive)
    assert "ended by itself (signal 9)" in link.sentence
    assert "kept" in link.sentence
    link.start({}, "hanger")
    assert link.sentence == ""
    hear_until(link, lambda: link.status.get("steps"))


@pytest.mark.parametrize(("order", "asked"), [({"refuse": True}, None), ({}, "fail")])
def test_an_error_of_the_bench_arrives_as_its_own_sentence(link, order, asked):
    link.start(order, "hanger")
    if asked:
        link.ask(asked)
    hear_until(link, lambda: not link.alive)
    assert link.sentence in ("this bench cannot be made", "the cloth is on fire; put it out")


def test_a_bench_that_is_done_is_no_accident(link):
    link.start({}, "hanger")
    link.ask("over")
    hear_until(link, lambda: not link.alive)
    assert link.sentence == ""


def test_ending_waits_until_everything_is_on_disk(link, tmp_path: Path):
    leaves = tmp_path / "kept"
    link.start({"leaves": str(leaves)}, "hanger")
    hear_until(link, lambda: link.status.get("steps"))
    process = psutil.Process(link.pid)
    link.end()
    assert leaves.read_text() == "kept"
    assert not process.is_running()
    assert link.sentence == ""


def test_sigterm_lets_the_bench_keep_what_it_has(link, tmp_path: Path):
    leaves = tmp_path / "kept"
    link.start({"leaves": str(leaves)}, "hanger")
    hear_until(link, lambda: link.status.get("steps"))
    psutil.Process(link.pid).terminate()
    hear_until(link, lambda: not link.alive)
    assert leaves.read_text() == "kept"


def test_another_order_ends_the_one_before(link):
    link.start({}, "hanger")
    first = psutil.Process(link.pid)
    link.start({}, "pickers")
    assert not first.is_running()
    hear_until(link, lambda: link.status.get("steps"))
