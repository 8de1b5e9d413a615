"""Interactive episodes with the real simulation, each in a process of its own."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest

from layflat.app.support.child_python import fork_server_context
from layflat.app.workstation.session.episode import EpisodeLost
from layflat.app.workstation.session.episode_process import EpisodeConfig, EpisodeProcess
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.session.status import EpisodeStatus
from layflat.app.workstation.teleop.teleop_input import TeleopInput, zero_input
from layflat.data.session.reader import open_session
from layflat.data.session.recorder import SessionRecorder
from layflat.data.tools.validate import validate
from layflat.data.types import ACTION_LIMIT_M, DragTarget, Episode
from layflat.policy.spec import PolicySpec
from layflat.policy.wrappers.takeover import REST_STEPS
from layflat.sim.conditions.variation import variation
from layflat.sim.config import SimConfig
from layflat.tests.factories import HANGER

PATIENCE_S = 60.0
DOWN = TeleopInput(motion=np.array([0.0, -1.0]), speed=0.5)
REST = TeleopInput(motion=np.zeros(2))


class Driver:
    """Waits for an episode, as a session never does."""

    def __init__(self, episode: EpisodeProcess, recorder: SessionRecorder) -> None:
        self.episode, self.recorder = episode, recorder

    def wait(self) -> EpisodeStatus:
        end = time.monotonic() + PATIENCE_S
        while self.episode.busy and not self.episode.ended:
            assert time.monotonic() < end
            self.episode.poll()
            time.sleep(0.002)
        return self.episode.status

    def step(self, teleop: TeleopInput = DOWN, drag: DragTarget | None = None) -> EpisodeStatus:
        self.episode.ask("step", "place", teleop, drag)
        return self.wait()

    def save(self, *arguments: str):
        self.episode.ask("save", *arguments)
        self.wait()
        return self.episode.saved


@pytest.fixture
def begin(tmp_path) -> Iterator[Callable[..., Driver]]:
    """``begin(**options of SessionRequest)``: an episode of seed 3 whose cloth hangs."""
    made: list[Driver] = []

    def start(**options) -> Driver:
        config = SimConfig(robot="hanger", cloth="napkin")
        request = SessionRequest(sim_config=config, session=tmp_path / "s.h5", **{"source": "gamepad"} | options)
        recorder = request.open_recorder()
        started_s = time.monotonic()
        config = EpisodeConfig(request=request, seed=3, journal=recorder.new_journal())
        made.append(
            Driver(EpisodeProcess(config, recorder, fork_server_context([EpisodeProcess.__module__])), recorder)
        )
        assert time.monotonic() - started_s < 5.0
        made[-1].wait()
        return made[-1]

    yield start
    for each in made:
        each.episode.discard()
        each.recorder.close()


def recorded(one: Driver, path: Path) -> Episode:
    one.recorder.close()
    assert validate(path) == ()
    with open_session(path) as session:
        return session[0]


def test_the_input_is_carried_out_and_saved(begin, tmp_path):
    one = begin(images=True)
    assert one.episode.status.steps == 0
    for n_steps in (1, 2, 3):
        status = one.step()
        assert (status.steps, status.stopped_by) == (n_steps, None)
        assert status.time_s == pytest.approx(0.1 * n_steps)
    assert status.verdict.words == "0 %, in the air"
    saved = one.save("failure", "converged")
    assert (saved.name, saved.n_steps, saved.outcome) == ("demo_0", 3, "failure")
    assert not psutil.pid_exists(one.episode.pid) or psutil.Process(one.episode.pid).status() == psutil.STATUS_ZOMBIE
    found = recorded(one, tmp_path / "s.h5")
    assert [step.action.tolist() for step in found.steps] == [DOWN.action.tolist()] * 3
    assert (found.source, found.seed, found.stopped_by) == ("gamepad", 3, "converged")
    assert found.final_observation.contact_portion == pytest.approx(status.contact)
    assert found.steps[0].observation.rgb is not None
    assert found.final_observation.holder_position[2] < found.steps[0].observation.holder_position[2] - 0.01


def test_no_call_waits(begin):
    """What is asked for while a step is under way is done afterwards, in order."""
    one = begin()
    started_s = time.monotonic()
    for _ in range(5):
        one.episode.ask("step", "place", DOWN, None)
    one.episode.ask("disturb", "push", 0)
    one.episode.ask("save", "partial", "interrupted")
    assert one.episode.busy
    assert time.monotonic() - started_s < 0.05
    one.wait()
    assert (one.episode.saved.n_steps, one.episode.status.disturbances) == (5, ("push",))


@pytest.mark.parametrize("n_steps", [0, 1])
def test_nothing_is_left_of_an_episode_that_is_empty_or_discarded(begin, tmp_path, n_steps):
    one = begin()
    if n_steps:
        one.step()
        one.episode.discard()
        one.episode.discard()
    else:
        assert one.save("success", "converged") is None
    one.recorder.close()
    assert not list(tmp_path.iterdir())


def test_the_hanger_follows_the_hand_and_what_it_did_is_the_action(begin, tmp_path):
    one = begin(source="kinesthetic")
    one.step(REST)
    hand = np.array([0.2, 0.0, 0.4])
    for _ in range(12):
        one.step(TeleopInput(motion=np.zeros(2), hand=hand))
    one.save("failure", "converged")
    found = recorded(one, tmp_path / "s.h5")
    start, end = found.steps[1].observation.holder_position, found.final_observation.holder_position
    assert np.linalg.norm(hand - end) < 0.7 * np.linalg.norm(hand - start)
    done = np.array([step.action for step in found.steps[1:]])
    assert np.abs(done).max() <= ACTION_LIMIT_M
    assert done.sum(axis=0) == pytest.approx((end - start)[[0, 2]], abs=0.01)
    assert all((step.hand_m == hand).all() for step in found.steps[1:])


def test_disturbances_and_drags_are_saved_with_the_episode(begin, tmp_path):
    one = begin()
    one.step()
    one.episode.ask("disturb", "push", 0)
    assert one.step().disturbed
    target = np.array([0.1, 0.0, 0.1])
    one.step(DOWN, DragTarget(node=0, target_m=target))
    one.save("failure", "converged")
    found = recorded(one, tmp_path / "s.h5")
    assert [(record.name, record.first_step) for record in found.disturbances] == [("push", 1)]
    assert [step.drag is not None for step in found.steps] == [False, False, True]
    assert found.steps[2].drag.target_m == pytest.approx(target)


def test_the_person_takes_over_and_without_the_device_never(begin, tmp_path):
    one = begin(policy=PolicySpec(builtin="stretch-right"))
    moves = [False, True, *[False] * 8, True, None, False]
    lost = zero_input(HANGER, connected=False, problem="unplugged")
    human = [one.step(lost if move is None else DOWN if move else REST).human_in_control for move in moves]
    # From the first motion until they have rested for so long.
    assert human == [False, *[True] * REST_STEPS, False, True, False, False]
    assert one.episode.status.intervention_steps == sum(human)
    one.step()
    one.episode.ask("release_control")
    assert not one.step(REST).human_in_control
    one.save("failure", "converged")
    found = recorded(one, tmp_path / "s.h5")
    assert found.source == "stretch-right+gamepad"
    assert [step.intervention for step in found.steps] == [*human, True, False]


def test_a_process_that_dies_is_reported_and_its_journal_saved(begin, tmp_path):
    one = begin()
    for _ in range(5):
        one.step()
    time.sleep(1.0)  # The journal is flushed twice a second.
    os.kill(one.episode.pid, signal.SIGSEGV)
    with pytest.raises(EpisodeLost, match="SIGSEGV"):
        one.step()
    saved = one.episode.recover()
    assert saved.outcome == "partial"
    assert 3 <= saved.n_steps <= 5
    assert recorded(one, tmp_path / "s.h5").stopped_by == "crashed"


@pytest.mark.parametrize("delay_s", [0.0, 0.01, 0.03, 0.06, 0.1])
def test_a_take_that_is_being_saved_survives_a_kill_at_any_moment(begin, tmp_path, delay_s):
    one = begin()
    for _ in range(4):
        one.step()
    time.sleep(0.7)
    one.episode.ask("save", "success", "converged")
    time.sleep(delay_s)
    with contextlib.suppress(ProcessLookupError):  # A fast machine has saved it by then.
        os.kill(one.episode.pid, signal.SIGKILL)
    try:
        one.wait()
        saved = one.episode.saved
    except EpisodeLost:
        saved = one.episode.recover()
    assert 3 <= saved.n_steps <= 4
    found = recorded(one, tmp_path / "s.h5")
    assert found.outcome == saved.outcome


def test_an_unknown_disturbance_is_one_sentence(begin):
    one = begin()
    one.episode.ask("disturb", "hurricane", 0)
    with pytest.raises(EpisodeLost, match="hurricane"):
        one.wait()


def test_each_take_has_the_conditions_that_its_seed_draws(begin):
    drawn = variation(["cloths"])
    driver = begin(variation=drawn)
    driver.step()
    driver.save("failure", "interrupted")
    with open_session(driver.recorder.path) as session:
        recorded = session.episode("demo_0")
    assert recorded.sim_config.items() >= drawn.sample(3).items()
    assert recorded.sim_config["mass_factor"] != 1.0
