"""Interactive episodes with the real simulation, each in a process of its own."""

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
from layflat.data.session.reader import open_session
from layflat.data.session.recorder import SessionRecorder
from layflat.data.tools.validate import validate
from layflat.data.types import ACTION_LIMIT_M, DragTarget, Episode
from layflat.sim.config import SimConfig

PATIENCE_S = 60.0
DOWN = TeleopInput(motion=np.array([0.0, -1.0]), speed=0.5)


@pytest.fixture
def begin(tmp_path) -> Iterator[Callable[..., EpisodeProcess]]:
    """``begin(images=False, source="gamepad")``: an episode of seed 3 whose cloth hangs."""
    made: list[tuple[EpisodeProcess, SessionRecorder]] = []

    def start(*, images: bool = False, source: str = "gamepad") -> EpisodeProcess:
        config = SimConfig(robot="hanger", cloth="napkin")
        recorder = SessionRecorder(
            tmp_path / "s.h5", robot=config.robot_spec, cloth="napkin", save_images=images, descriptor=config.descriptor
        )
        episode = make_handle_factory(recorder, config, source)(3)
        made.append((episode, recorder))
        end = time.monotonic() + PATIENCE_S
        while not episode.ready():
            assert time.monotonic() < end
            time.sleep(0.02)
        return episode

    start.recorder = lambda: made[-1][1]
    yield start
    for episode, recorder in made:
        episode.discard()
        recorder.close()


def recorded(begin, path: Path) -> Episode:
    begin.recorder().close()
    assert validate(path) == ()
    with open_session(path) as session:
        return session[0]


def test_the_input_is_carried_out_and_saved(begin, tmp_path):
    episode = begin(images=True)
    assert episode.status().n_steps == 0
    height = episode.status().holder_m[2]
    for n_steps in (1, 2, 3):
        status = episode.step(DOWN)
        assert (status.n_steps, status.stopped_by) == (n_steps, None)
        assert status.time_s == pytest.approx(0.1 * n_steps)
    assert status.holder_m[2] < height - 0.01
    saved = episode.save("failure", "converged")
    assert (saved.name, saved.n_steps, saved.outcome) == ("demo_0", 3, "failure")
    assert not psutil.pid_exists(episode.pid) or psutil.Process(episode.pid).status() == psutil.STATUS_ZOMBIE
    found = recorded(begin, tmp_path / "s.h5")
    assert [step.action.tolist() for step in found.steps] == [DOWN.action.tolist()] * 3
    assert (found.source, found.seed, found.stopped_by) == ("gamepad", 3, "converged")
    assert found.final_observation.contact_portion == pytest.approx(status.contact_portion)
    assert found.steps[0].observation.rgb is not None


@pytest.mark.parametrize("n_steps", [0, 1])
def test_nothing_is_left_of_an_episode_that_is_empty_or_discarded(begin, tmp_path, n_steps):
    episode = begin()
    if n_steps:
        episode.step(DOWN)
        episode.discard()
        episode.discard()
    else:
        assert episode.save("success", "converged") is None
    begin.recorder().close()
    assert not list(tmp_path.iterdir())


def test_the_hanger_follows_the_hand_and_what_it_did_is_the_action(begin, tmp_path):
    episode = begin(source="kinesthetic")
    start = np.array(episode.status().holder_m)
    hand = start + np.array([0.06, 0.0, -0.04])
    for _ in range(12):
        status = episode.step(TeleopInput(motion=np.zeros(2), hand=hand))
    went = np.array(status.holder_m) - start
    assert np.linalg.norm(hand - status.holder_m) < 0.5 * np.linalg.norm(hand - start)
    episode.save("success", "converged")
    found = recorded(begin, tmp_path / "s.h5")
    done = np.array([step.action for step in found.steps])
    assert np.abs(done).max() <= ACTION_LIMIT_M
    assert done.sum(axis=0) == pytest.approx(went[[0, 2]], abs=0.01)
    assert all((step.hand_m == hand).all() for step in found.steps)


def test_disturbances_and_drags_are_saved_with_the_episode(begin, tmp_path):
    episode = begin()
    episode.step(DOWN)
    episode.disturb("push")
    assert episode.step(DOWN).disturbed
    target = np.array([0.1, 0.0, 0.1])
    episode.step(DOWN, DragTarget(node=0, target_m=target))
    episode.save("success", "converged")
    found = recorded(begin, tmp_path / "s.h5")
    assert [(record.name, record.first_step) for record in found.disturbances] == [("push", 1)]
    assert [step.drag is not None for step in found.steps] == [False, False, True]
    assert found.steps[2].drag.target_m == pytest.approx(target)


def test_a_process_that_dies_is_reported_and_its_journal_saved(begin, tmp_path):
    episode = begin()
    for _ in range(5):
        episode.step(DOWN)
    time.sleep(1.0)  # The journal is flushed twice a second.
    os.kill(episode.pid, signal.SIGSEGV)
    with pytest.raises(EpisodeLost, match="SIGSEGV"):
        episode.step(DOWN)
    saved = episode.save("partial", "crashed")
    assert saved.outcome == "partial"
    assert 3 <= saved.n_steps <= 5
    assert recorded(begin, tmp_path / "s.h5").stopped_by == "crashed"


def test_an_unknown_disturbance_is_one_sentence(begin):
    with pytest.raises(EpisodeLost, match="hurricane"):
        begin().disturb("hurricane")
