"""Takes with the real simulation, each in a process of its own."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest

from layflat.app.workstation.session.episode_handle import EpisodeLost
from layflat.app.workstation.session.episode_process import EpisodeProcess, make_handle_factory
from layflat.app.workstation.teleop.teleop_input import TeleopInput
from layflat.data import validate
from layflat.data.session.reader import open_session
from layflat.data.session.recorder import SessionRecorder
from layflat.data.types import ACTION_LIMIT_M, DragTarget
from layflat.sim.config import SimConfig

PATIENCE_S = 60.0
DOWN = TeleopInput(motion=np.array([0.0, -1.0]), speed=0.5)


@pytest.fixture
def session(tmp_path) -> Path:
    return tmp_path / "s.h5"


@pytest.fixture
def begin(session) -> Iterator[Callable[..., EpisodeProcess]]:
    """``begin(images=False, **bench settings)``: a take of seed 3 whose cloth hangs."""
    made: list[tuple[EpisodeProcess, SessionRecorder]] = []

    def start(*, images: bool = False, source: str = "gamepad", **options) -> EpisodeProcess:
        settings = SimConfig(**({"robot": "hanger", "cloth": "napkin"} | options))
        recorder = SessionRecorder(session, robot=settings.robot, cloth="napkin", save_images=images)
        take = make_handle_factory(recorder, settings, source)(3)
        made.append((take, recorder))
        give_up = time.monotonic() + PATIENCE_S
        while not take.ready():
            assert time.monotonic() < give_up
            time.sleep(0.02)
        return take

    start.recorder = lambda: made[-1][1]
    yield start
    for take, recorder in made:
        take.discard()
        recorder.close()


def pid_of(take: EpisodeProcess) -> int:
    return int(take._process.pid)


def test_what_the_hands_ask_for_is_what_is_done_and_kept(begin, session):
    take = begin(images=True)
    assert take.glance().n_steps == 0
    height = take.glance().holder_m[2]
    for n_steps in (1, 2, 3):
        glance = take.step(DOWN)
        assert (glance.n_steps, glance.stopped_by) == (n_steps, None)
        assert glance.time_s == pytest.approx(0.1 * n_steps)
    assert glance.holder_m[2] < height - 0.01
    kept = take.keep("failure", "converged")
    assert (kept.name, kept.n_steps, kept.outcome) == ("demo_0", 3, "failure")
    assert not psutil.pid_exists(pid_of(take)) or psutil.Process(pid_of(take)).status() == psutil.STATUS_ZOMBIE
    begin.recorder().close()
    with open_session(session) as found:
        episode = found[0]
    assert [step.action.tolist() for step in episode.steps] == [DOWN.action.tolist()] * 3
    assert (episode.source, episode.seed, episode.stopped_by) == ("gamepad", 3, "converged")
    assert episode.final_observation.contact_portion == pytest.approx(glance.contact_portion)
    assert episode.steps[0].observation.rgb is not None
    assert validate(session) == ()


def test_a_take_without_steps_is_not_kept(begin, session):
    take = begin()
    assert take.keep("success", "converged") is None
    begin.recorder().close()
    assert not list(session.parent.iterdir())


def test_discarding_leaves_nothing(begin, session):
    take = begin()
    take.step(DOWN)
    take.discard()
    take.discard()
    begin.recorder().close()
    assert not list(session.parent.iterdir())


def test_led_by_hand_the_hanger_follows_and_what_it_did_is_the_action(begin, session):
    take = begin(source="kinesthetic")
    start = np.array(take.glance().holder_m)
    hand = start + np.array([0.06, 0.0, -0.04])
    for _ in range(12):
        glance = take.step(TeleopInput(motion=np.zeros(2), hand=hand))
    went = np.array(glance.holder_m) - start
    assert np.linalg.norm(hand - glance.holder_m) < 0.5 * np.linalg.norm(hand - start)
    take.keep("success", "converged")
    begin.recorder().close()
    with open_session(session) as found:
        episode = found[0]
    done = np.array([step.action for step in episode.steps])
    assert np.abs(done).max() <= ACTION_LIMIT_M
    assert done.sum(axis=0) == pytest.approx(went[[0, 2]], abs=0.01)
    assert all((step.hand_m == hand).all() for step in episode.steps)


def test_disturbances_and_pulls_are_kept_with_the_episode(begin, session):
    take = begin()
    take.step(DOWN)
    take.disturb("push")
    assert take.step(DOWN).disturbed
    target = np.array([0.1, 0.0, 0.1])
    take.step(DOWN, DragTarget(node=0, target_m=target))
    take.keep("success", "converged")
    begin.recorder().close()
    with open_session(session) as found:
        episode = found[0]
    assert [(record.name, record.first_step) for record in episode.disturbances] == [("push", 1)]
    assert [step.drag is not None for step in episode.steps] == [False, False, True]
    assert episode.steps[2].drag.target_m == pytest.approx(target)


def test_a_simulation_that_dies_is_said_and_its_journal_kept(begin, session):
    take = begin()
    for _ in range(5):
        take.step(DOWN)
    time.sleep(1.0)  # The journal is flushed twice a second.
    os.kill(pid_of(take), signal.SIGSEGV)
    with pytest.raises(EpisodeLost, match=f"status -{signal.SIGSEGV.value}"):
        take.step(DOWN)
    kept = take.keep("partial", "crashed")
    assert kept.outcome == "partial"
    assert 3 <= kept.n_steps <= 5
    begin.recorder().close()
    with open_session(session) as found:
        assert found[0].stopped_by == "crashed"


def test_a_disturbance_that_nobody_knows_is_one_sentence(begin):
    take = begin()
    with pytest.raises(EpisodeLost, match="hurricane"):
        take.disturb("hurricane")
