"""RecordingSession over fake episodes, with real session files."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from layflat.app.workstation.session.episode_handle import EpisodeLost
from layflat.app.workstation.session.recording_session import COUNTDOWN_S
from layflat.app.workstation.session.session_queries import n_episodes, recorded_seeds
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.data.session.reader import open_session
from layflat.data.session.recorder import SessionRecorder
from layflat.tests.app.workstation.fakes import AT_REST, DISCONNECTED, FORWARD, Recording
from layflat.tests.factories import PICKERS

KEPT = re.compile(r"kept demo_\d+ (success|failure|partial) \d+ steps contact [01]\.\d\d \S+")
DISCARDED = re.compile(r"discarded seed \d+ \d+ steps contact [01]\.\d\d \S+")


def outcomes(path: Path) -> list[tuple[int, str, int, str]]:
    with open_session(path) as session:
        return [(info.seed, info.outcome, info.n_steps, info.stopped_by) for info in session.infos().values()]


def test_episodes_are_kept_discarded_and_redone(record, tmp_path):
    one = record(seed=4)
    one.begin(n_steps=3)
    one.give(Command.KEEP_SUCCESS)
    assert "1 demonstration in" in one.session.message
    one.begin(n_steps=2)
    one.give(Command.DISCARD)
    one.begin(n_steps=5)
    one.give(Command.REDO)
    assert (one.state, one.session.seed) == ("countdown", 6)
    one.now += COUNTDOWN_S
    one.session.step()
    one.step(FORWARD, 7)
    one.give(Command.KEEP_FAILURE)
    assert one.state == "waiting"
    one.give(Command.QUIT)
    assert one.state == "over"
    assert [episode.seed for episode in one.episodes] == [4, 5, 6, 6, 7]
    assert [bool(KEPT.fullmatch(line) or DISCARDED.fullmatch(line)) for line in one.lines] == [True] * 4
    assert one.lines[0] == f"kept demo_0 success 3 steps contact 0.50 {tmp_path / 's.h5'}"
    assert one.lines[1] == f"discarded seed 5 2 steps contact 0.02 {tmp_path / 's.h5'}"
    assert one.session.counts == {"success": 1, "failure": 1, "partial": 0, "discarded": 2}
    one.recorder.close()
    assert outcomes(tmp_path / "s.h5") == [(4, "success", 3, "converged"), (6, "failure", 7, "converged")]


def test_it_is_over_when_so_many_are_kept(record):
    one = record(episodes=2)
    for command, state in (
        (Command.KEEP_SUCCESS, "waiting"),
        (Command.DISCARD, "waiting"),
        (Command.KEEP_FAILURE, "over"),
    ):
        one.begin(n_steps=1)
        one.give(command)
        assert one.state == state


def test_nothing_runs_before_the_countdown_has_ended_and_the_cloth_hangs(record):
    one = record()
    one.episodes[0].hangs = False
    one.give(Command.START)
    one.now += COUNTDOWN_S - 0.01
    assert (one.step(FORWARD, 3), one.state) == (0, "countdown")
    one.now += 1.0
    assert one.step(FORWARD, 3) == 0  # The cloth is still being hung.
    one.episodes[0].hangs = True
    one.session.step()
    assert one.state == "running"


def test_time_waits_for_the_first_motion(record):
    one = record()
    one.begin()
    assert one.session.waiting_for_motion
    assert one.step(AT_REST, 5) == 0
    assert one.step(FORWARD) == 1
    assert one.step(AT_REST) == 1  # Rest in between is part of the demonstration.
    assert [bool(teleop.moving) for teleop in one.episodes[0].inputs] == [True, False]


def test_a_pause_stops_time_until_either_button_continues(record):
    one = record()
    one.begin(n_steps=2)
    for button in (Command.PAUSE, Command.START):
        one.give(Command.PAUSE)
        assert (one.state, one.step(FORWARD, 4)) == ("paused", 0)
        one.give(button)
        assert one.step(FORWARD, 2) == 2
    one.give(Command.PAUSE, Command.KEEP_SUCCESS)
    assert one.session.counts["success"] == 1


def test_a_disconnected_device_pauses_until_it_is_back(record):
    one = record()
    one.begin(n_steps=2)
    for _ in range(2):
        assert one.step(DISCONNECTED) == 0
        assert (one.state, one.session.message) == ("paused", f"paused: {DISCONNECTED.problem}")
    assert one.step(replace(AT_REST, device="Pad")) == 0  # Time waits for motion again.
    assert one.state == "running"
    assert "Pad is connected again" in one.session.message
    assert one.step(FORWARD, 3) == 3
    assert one.session.status.n_steps == 5


def test_a_pause_of_the_person_outlasts_a_disconnect(record):
    one = record()
    one.begin(n_steps=1)
    one.give(Command.PAUSE)
    one.step(DISCONNECTED)
    one.step(AT_REST)
    assert one.state == "paused"


def test_a_disconnect_in_the_countdown_restarts_it(record):
    one = record()
    one.give(Command.START)
    one.step(DISCONNECTED)
    one.now += 2 * COUNTDOWN_S
    assert one.state == "paused"
    one.step(AT_REST)
    assert (one.state, one.session.countdown_left_s()) == ("countdown", COUNTDOWN_S)


def test_a_diverged_simulation_is_no_success(record, tmp_path):
    one = record()
    one.episodes[0].stops = {3: "unstable"}
    one.begin(n_steps=3)
    assert one.state == "finished"
    one.give(Command.KEEP_SUCCESS)
    assert one.state == "finished"
    one.give(Command.KEEP_FAILURE)
    one.close()
    assert outcomes(tmp_path / "s.h5") == [(0, "failure", 3, "unstable")]


def test_the_step_limit_leaves_only_the_verdict(record, tmp_path):
    one = record(max_steps=4)
    one.begin()
    assert one.step(FORWARD, 9) == 4
    assert one.state == "finished"
    one.give(Command.KEEP_SUCCESS)
    one.close()
    assert outcomes(tmp_path / "s.h5") == [(0, "success", 4, "step_limit")]


def test_quitting_keeps_a_running_demonstration_as_partial(record, tmp_path):
    one = record()
    one.begin(n_steps=4)
    one.give(Command.QUIT)
    assert one.state == "over"
    assert KEPT.fullmatch(one.lines[-1])
    one.recorder.close()
    assert outcomes(tmp_path / "s.h5") == [(0, "partial", 4, "interrupted")]


def test_a_lost_simulation_leaves_its_steps_and_the_same_seed_again(record, tmp_path):
    one = record(seed=9)
    one.episodes[0].dies_at = 3
    one.begin(n_steps=5)
    assert one.state == "waiting"
    assert [episode.seed for episode in one.episodes] == [9, 9]
    assert "was lost" in one.session.message
    one.close()
    assert outcomes(tmp_path / "s.h5") == [(9, "partial", 3, "crashed")]


def test_an_error_while_the_cloth_is_hung_is_raised(record):
    one = record()

    def lose() -> bool:
        raise EpisodeLost("there is no memory")

    one.episodes[0].ready = lose
    with pytest.raises(EpisodeLost, match="no memory"):
        one.session.step()


@pytest.mark.parametrize(("disturbance", "expected"), [("none", []), ("push", ["push"])])
def test_disturbing_needs_a_disturbance_and_a_running_demonstration(record, disturbance, expected):
    one = record(disturbance=disturbance)
    one.give(Command.DISTURB)
    one.begin(n_steps=1)
    one.give(Command.DISTURB, Command.DISTURB)
    assert one.episodes[0].disturbances == expected


def test_a_further_recording_starts_with_the_next_seed(record, tmp_path):
    path, first = tmp_path / "s.h5", record()
    for verdict in (Command.KEEP_SUCCESS, Command.DISCARD, Command.KEEP_FAILURE, Command.QUIT):
        first.begin(n_steps=2)
        first.give(verdict)
    first.close()
    assert recorded_seeds(path, "keyboard") == {0, 2}  # The partial one of seed 3 is done again.
    assert recorded_seeds(path, "gamepad") == frozenset()
    assert n_episodes(path) == 3
    second = record(used_seeds=recorded_seeds(path, "keyboard"))
    assert second.session.seed == 1
    second.begin(n_steps=2)
    second.give(Command.KEEP_SUCCESS)
    assert second.session.seed == 3
    assert "4 demonstrations" in second.session.message
    second.close()
    with pytest.raises(ValueError, match="robot hanger, not pickers"):
        SessionRecorder(path, robot=PICKERS, cloth="towel")


class TestCorrection:
    """A policy places, and the person takes over."""

    @pytest.fixture
    def running(self, record) -> Recording:
        one = record(policy_in_control=True)
        one.episodes[0].has_policy = True
        one.begin()
        return one

    def test_time_waits_for_nothing_while_the_policy_is_in_control(self, running):
        assert not running.session.waiting_for_motion
        assert running.step(AT_REST, 5) == 5
        running.give(Command.PAUSE)
        assert running.step(AT_REST, 5) == 0
        running.give(Command.PAUSE)
        assert running.step(AT_REST, 2) == 2

    def test_after_the_policy_has_stopped_time_waits_for_motion(self, running):
        running.episodes[0].stops = {2: "threshold"}
        assert running.step(AT_REST, 6) == 2
        assert running.session.waiting_for_motion
        assert "has stopped (threshold)" in running.session.message
        assert running.session.effect(Command.KEEP_SUCCESS)
        assert running.step(FORWARD) == 1
        assert "you are in control" in running.session.message
        assert running.step(AT_REST) == 1

    def test_it_says_who_is_in_control_and_a_button_returns_it(self, running):
        assert running.step(AT_REST, 2) == 2
        assert running.session.effect(Command.START) is None
        assert running.step(FORWARD) == 1
        assert "you are in control" in running.session.message
        assert running.session.effect(Command.START) == "return control to the policy"
        running.give(Command.START)
        assert running.state == "running"
        assert running.step(AT_REST) == 1
        assert not running.session.status.human_in_control
        assert running.session.message == "the policy is in control"

    def test_a_disconnected_device_pauses_the_correction(self, running):
        assert running.step(FORWARD, 2) == 2
        assert running.step(DISCONNECTED) == 0
        assert running.session.message == f"paused: {DISCONNECTED.problem}"
        running.session.handle_input(AT_REST)
        assert "connected again; the policy places; move to take over" in running.session.message
        assert running.step(AT_REST, 2) == 2


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.sampled_from([*Command, "move", "wait", "disconnect"]), max_size=25))
def test_the_session_holds_what_was_printed_after_any_commands(tmp_path_factory, acts):
    """A command with an effect has one, every other changes nothing; lines and files agree."""
    path = tmp_path_factory.mktemp("any") / "s.h5"
    one = Recording(path, disturbance="push")

    def snapshot() -> tuple[object, ...]:
        return one.state, one.session.seed, len(one.episodes), len(one.lines), len(one.episodes[-1].disturbances)

    for act in acts:
        if act == "move":
            one.step(FORWARD, 2)
        elif act == "wait":
            one.now += COUNTDOWN_S
            one.session.step()
        elif act == "disconnect":
            one.session.handle_input(DISCONNECTED)
        else:
            before, effect = snapshot(), one.session.effect(act)
            one.session.handle_command(act)
            assert (before != snapshot()) == (effect is not None)
    one.close()
    one.close()
    kept = [line.split() for line in one.lines if line.startswith("kept")]
    found = outcomes(path) if kept else []
    assert [(outcome, n_steps) for _, outcome, n_steps, _ in found] == [(words[2], int(words[3])) for words in kept]
    assert n_episodes(path) == len(kept)
    assert sum(episode.discarded for episode in one.episodes) + len(kept) == len(one.episodes)
