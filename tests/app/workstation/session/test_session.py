"""Session over fake episodes, with real session files."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from layflat.app.workstation.session.effects import NOTE_S
from layflat.app.workstation.session.episode import EpisodeLost
from layflat.app.workstation.session.request import COUNTDOWN_S
from layflat.app.workstation.session.session_queries import n_episodes, recorded_seeds
from layflat.app.workstation.session.status import YOU, Message
from layflat.app.workstation.session.take import MAX_STEPS, SETTLE_STEPS
from layflat.app.workstation.teleop.teleop_input import Command
from layflat.data.environment_spec import StepLimits
from layflat.data.session.reader import open_session
from layflat.data.types import DragTarget
from layflat.tests.app.workstation.fakes import AT_REST, DISCONNECTED, FLAT, FOLDED, FORWARD, Recording

KEPT = re.compile(r"kept demo_\d+ (success|failure|partial) \d+ steps contact [01]\.\d\d \S+")
DISCARDED = re.compile(r"discarded seed \d+ \d+ steps contact [01]\.\d\d \S+")
PULL = DragTarget(node=0, target_m=[0.1, 0.0, 0.1])


def outcomes(path: Path) -> list[tuple[int, str, int, str]]:
    with open_session(path) as session:
        return [(info.seed, info.outcome, info.n_steps, info.stopped_by) for info in session.infos().values()]


def test_takes_are_kept_discarded_and_redone(record, tmp_path):
    one = record(seed=4)
    one.begin(n_steps=3)
    one.give(Command.KEEP_SUCCESS)
    assert one.message == f"kept demo_0 as success (99 %, flat); 1 demonstration in {tmp_path / 's.h5'}"
    assert one.status.message.level == "success"
    one.begin(n_steps=2)
    one.give(Command.DISCARD)
    one.begin(n_steps=5)
    one.episode.verdict = FOLDED
    one.give(Command.REDO)
    assert (one.state, one.status.seed) == ("countdown", 6)
    one.now += COUNTDOWN_S
    one.step(FORWARD, 7)
    one.episode.status = replace(one.episode.status, verdict=FOLDED)
    one.give(Command.KEEP_FAILURE)
    assert one.state == "waiting"
    one.give(Command.QUIT)
    assert one.state == "over"
    assert [episode.seed for episode in one.episodes] == [4, 5, 6, 6, 7]
    assert [bool(KEPT.fullmatch(line) or DISCARDED.fullmatch(line)) for line in one.lines] == [True] * 4
    assert one.lines[0] == f"kept demo_0 success 3 steps contact 0.50 {tmp_path / 's.h5'}"
    assert one.lines[1] == f"discarded seed 5 2 steps contact 0.02 {tmp_path / 's.h5'}"
    assert one.status.counts == {"success": 1, "failure": 1, "partial": 0, "discarded": 2}
    one.close()
    assert outcomes(tmp_path / "s.h5") == [(4, "success", 3, "converged"), (6, "failure", 7, "converged")]


def test_it_is_over_when_so_many_are_kept_and_it_says_target_and_pace(record):
    one = record(episodes=2)
    assert one.status.progress == "0 of 2"
    for command, state in (
        (Command.KEEP_SUCCESS, "waiting"),
        (Command.DISCARD, "waiting"),
        (Command.KEEP_SUCCESS, "over"),
    ):
        one.begin(n_steps=10)
        one.give(command)
        assert one.state == state
    assert one.session.done
    # From the first start on: two countdowns and three takes of a second.
    assert one.status.pace_s == pytest.approx((2 * COUNTDOWN_S + 3.0) / 2, abs=0.2)
    assert one.status.progress.startswith("2 of 2, ")


def test_it_is_not_over_before_the_last_take_is_durable(record):
    one = record(episodes=1)
    one.begin(n_steps=2)
    one.episode.holds = True
    one.give(Command.KEEP_SUCCESS)
    one.session.update()
    assert (one.state, one.lines) == ("waiting", [])
    assert not one.session.done
    one.episode.holds = False
    one.session.update()
    assert one.session.done
    assert len(one.episodes) == 1


def test_the_next_cloth_is_hung_while_a_take_is_saved(record):
    one = record()
    one.begin(n_steps=2)
    saved = one.episode
    saved.holds = True
    one.give(Command.KEEP_SUCCESS)
    one.begin(n_steps=3)
    assert (one.n_steps, one.lines) == (3, [])
    saved.holds = False
    one.session.update()
    assert KEPT.fullmatch(one.lines[0])


def test_nothing_runs_before_the_countdown_has_ended_and_the_cloth_hangs(record):
    one = record()
    one.episode.hangs = False
    one.give(Command.START)
    one.now += COUNTDOWN_S - 0.01
    assert (one.step(FORWARD, 1), one.state) == (0, "countdown")
    one.now += 1.0
    assert one.step(FORWARD, 3) == 0
    assert one.message == "seed 0: hanging the cloth"
    one.episode.hangs = True
    one.session.update()
    assert one.step(FORWARD) == 1


def test_time_waits_for_the_first_motion(record):
    one = record()
    one.begin()
    assert (one.state, one.message) == ("still", "time stands until you move")
    assert one.step(AT_REST, 5) == 0
    assert one.step(FORWARD) == 1
    assert one.message == "recording"
    assert one.step(AT_REST) == 1  # Rest in between is part of the demonstration.
    assert [bool(teleop.moving) for teleop in one.episode.inputs] == [True, False]


def test_a_step_never_waits_and_acts_on_the_newest_input(record):
    """While a step is under way everything else is answered; the next step takes the input of the moment."""
    one = record()
    one.begin(n_steps=1)
    one.episode.work_s = lambda: 0.35
    one.session.handle_input(FORWARD)
    one.session.update()
    for _ in range(30):
        one.now += 0.01
        assert one.session.update() >= 0
    one.session.handle_input(AT_REST)
    one.episode.work_s = lambda: 0.0
    one.now += 0.06
    one.session.update()
    one.session.update()
    assert [teleop.moving for teleop in one.episode.inputs] == [True, True, False]


def test_a_pause_stops_time_until_either_button_continues(record):
    one = record()
    one.begin(n_steps=2)
    for button in (Command.PAUSE, Command.START):
        one.give(Command.PAUSE)
        assert (one.state, one.step(FORWARD, 4)) == ("paused", 0)
        assert one.message == "time stands until you continue"
        one.give(button)
        assert one.step(FORWARD, 2) == 2
    one.give(Command.PAUSE, Command.KEEP_SUCCESS)
    assert one.status.counts["success"] == 1


def test_a_disconnected_device_pauses_until_it_is_back(record):
    one = record()
    one.begin(n_steps=2)
    for _ in range(2):
        assert one.step(DISCONNECTED) == 0
        assert (one.state, one.message) == ("paused", DISCONNECTED.problem)
    assert one.step(replace(AT_REST, device="Pad")) == 0  # Time waits for motion again.
    assert one.state == "still"
    assert one.message == "Pad is connected again; time stands until you move"
    assert one.step(FORWARD, 3) == 3
    assert one.n_steps == 5


def test_a_pause_of_the_person_outlasts_a_disconnect(record):
    one = record()
    one.begin(n_steps=1)
    one.give(Command.PAUSE)
    one.step(DISCONNECTED)
    one.step(AT_REST)
    assert one.state == "paused"


def test_a_disconnect_in_the_countdown_restarts_it(record):
    one = record()
    one.session.update()
    one.give(Command.START)
    one.step(DISCONNECTED)
    one.now += 2 * COUNTDOWN_S
    assert one.state == "paused"
    one.session.handle_input(AT_REST)
    assert (one.state, one.status.countdown_s) == ("countdown", COUNTDOWN_S)


def test_a_diverged_simulation_is_no_success(record, tmp_path):
    one = record()
    one.episode.stops, one.episode.verdict = {3: "unstable"}, FOLDED
    one.begin(n_steps=3)
    assert one.state == "finished"
    assert "diverged" in one.message
    one.give(Command.KEEP_SUCCESS)
    assert one.state == "finished"
    one.give(Command.KEEP_FAILURE)
    one.close()
    assert outcomes(tmp_path / "s.h5") == [(0, "failure", 3, "unstable")]


def test_the_step_limit_leaves_only_the_label(record, tmp_path):
    one = record()
    one.begin()
    assert one.step(FORWARD, MAX_STEPS + 5) == MAX_STEPS
    assert one.state == "finished"
    assert f"{MAX_STEPS} steps are the most" in one.message
    one.give(Command.KEEP_SUCCESS)
    one.close()
    assert outcomes(tmp_path / "s.h5") == [(0, "success", MAX_STEPS, "step_limit")]


def test_quitting_keeps_a_running_take_as_partial(record, tmp_path):
    one = record()
    one.begin(n_steps=4)
    one.give(Command.QUIT)
    assert one.state == "over"
    assert KEPT.fullmatch(one.lines[-1])
    one.close()
    assert outcomes(tmp_path / "s.h5") == [(0, "partial", 4, "interrupted")]


def test_a_lost_simulation_leaves_its_steps_and_the_same_seed_again(record, tmp_path):
    one = record(seed=9)
    one.episode.dies_at = 3
    one.begin(n_steps=5)
    assert one.state == "waiting"
    assert [episode.seed for episode in one.episodes] == [9, 9]
    assert one.status.message == Message(text="the simulation was lost; its steps are kept as partial", level="error")
    one.close()
    assert outcomes(tmp_path / "s.h5") == [(9, "partial", 3, "crashed")]


def test_a_take_that_is_lost_while_it_is_saved_is_done_again(record, tmp_path):
    one = record(episodes=1)
    one.begin(n_steps=3)

    def lose() -> bool:
        raise EpisodeLost("there is no memory")

    one.episode.poll = lose
    one.give(Command.KEEP_SUCCESS)
    assert (one.state, len(one.episodes)) == ("waiting", 2)
    one.close()
    assert outcomes(tmp_path / "s.h5") == [(0, "partial", 3, "crashed")]


def test_an_error_while_the_cloth_is_hung_is_raised(record):
    one = record()

    def lose() -> bool:
        raise EpisodeLost("there is no memory")

    one.episode.poll = lose
    with pytest.raises(EpisodeLost, match="no memory"):
        one.session.update()


@pytest.mark.parametrize(("disturbance", "expected"), [("none", []), ("push", ["push"])])
def test_the_command_disturbs_with_a_disturbance_and_in_a_take(record, disturbance, expected):
    one = record(disturbance=disturbance)
    one.give(Command.DISTURB)
    one.begin(n_steps=1)
    one.give(Command.DISTURB)
    one.give(Command.DISTURB)
    assert one.episode.disturbances == expected


def test_a_further_session_starts_with_the_next_seed(record, tmp_path):
    path, first = tmp_path / "s.h5", record()
    for label in (Command.KEEP_SUCCESS, Command.DISCARD, Command.KEEP_SUCCESS, Command.QUIT):
        first.begin(n_steps=2)
        first.give(label)
    first.close()
    assert recorded_seeds(path, "keyboard") == {0, 2}  # The partial one of seed 3 is done again.
    assert recorded_seeds(path, "gamepad") == frozenset()
    assert n_episodes(path) == 3
    second = record(used_seeds=recorded_seeds(path, "keyboard"), n_episodes=3)
    assert second.status.seed == 1
    second.begin(n_steps=5)
    second.give(Command.KEEP_SUCCESS)
    assert second.status.seed == 3
    assert "4 demonstrations" in second.message


class TestUndo:
    """A discarded take comes back as it was, until the next one begins."""

    @pytest.mark.parametrize("command", [Command.DISCARD, Command.REDO])
    def test_it_is_brought_back_and_kept(self, record, tmp_path, command):
        one = record(seed=5)
        one.begin(n_steps=109)
        first = one.episode
        one.give(command)
        assert not first.gone
        assert one.status.discarded == (5, 109)
        assert one.status.effect(Command.UNDO) == "bring back seed 5 with its 109 steps"
        # Pressed twice, it does no more than once.
        assert (one.status.effect(Command.DISCARD) is None) == (one.state == "waiting")
        assert (one.lines, one.status.counts["discarded"]) == ([], 1)
        one.give(Command.UNDO)
        assert (one.state, one.n_steps, one.status.seed) == ("paused", 109, 5)
        assert one.message == "seed 5 is back with its 109 steps"
        assert one.status.counts["discarded"] == 0
        assert one.episodes[1].gone
        assert first.shown == 1
        assert one.status.effect(Command.UNDO) is None
        one.give(Command.START)
        assert one.step(FORWARD) == 1
        one.give(Command.KEEP_SUCCESS)
        one.close()
        assert outcomes(tmp_path / "s.h5") == [(5, "success", 110, "converged")]
        assert len(one.lines) == 1

    def test_it_is_gone_with_the_first_step_of_the_next_one(self, record):
        one = record()
        one.begin(n_steps=7)
        one.give(Command.DISCARD)
        one.begin()
        assert one.status.effect(Command.UNDO)
        one.step(FORWARD)
        assert one.status.effect(Command.UNDO) is None
        assert one.episodes[0].gone
        assert one.lines == [f"discarded seed 0 7 steps contact 0.07 {one.status.file}"]

    def test_it_is_gone_when_the_session_is_closed(self, record):
        one = record()
        one.begin(n_steps=7)
        one.give(Command.DISCARD, Command.QUIT)
        assert one.episodes[0].gone
        assert [line.split()[0] for line in one.lines] == ["discarded"]

    def test_a_finished_take_comes_back_finished(self, record):
        one = record(policy=True)
        one.episode.stops, one.episode.has_policy = {2: "threshold"}, True
        one.begin()
        one.step(AT_REST, 4)
        assert one.state == "stopped"
        one.give(Command.DISCARD)
        one.give(Command.UNDO)
        assert (one.state, one.status.stopped_by) == ("stopped", "threshold")


class TestQuestion:
    """It asks where label and verdict disagree."""

    @pytest.fixture
    def folded(self, record) -> Recording:
        one = record()
        one.verdict = one.episode.verdict = FOLDED
        one.begin(n_steps=3)
        one.give(Command.KEEP_SUCCESS)
        return one

    def test_success_of_a_folded_cloth_is_asked(self, folded):
        assert (folded.state, folded.lines) == ("asking", [])
        assert folded.status.question == "77 %, folded over at the free edge: keep as success?"
        assert folded.status.message.level == "warning"
        assert folded.status.verdict == FOLDED
        assert folded.status.effect(Command.KEEP_SUCCESS) == "yes, keep as success"
        assert folded.status.effect(Command.KEEP_FAILURE) == "keep as failure"
        assert folded.step(FORWARD, 3) == 0

    @pytest.mark.parametrize("yes", [lambda s: s.answer(True), lambda s: s.handle_command(Command.KEEP_SUCCESS)])
    def test_yes_keeps_it(self, folded, yes):
        yes(folded.session)
        folded.session.update()
        assert folded.lines[0].startswith("kept demo_0 success")
        assert "77 %, folded over at the free edge" in folded.message

    def test_the_other_label_keeps_it(self, folded):
        folded.give(Command.KEEP_FAILURE)
        assert folded.lines[0].startswith("kept demo_0 failure")

    @pytest.mark.parametrize(
        "no", [lambda s: s.answer(False), *(lambda s, c=c: s.handle_command(c) for c in (Command.PAUSE, Command.START))]
    )
    def test_no_goes_back_and_time_stands(self, folded, no):
        no(folded.session)
        assert (folded.state, folded.status.question) == ("paused", "")
        folded.give(Command.START)
        assert folded.step(FORWARD) == 1

    def test_failure_of_a_flat_cloth_is_asked(self, record):
        one = record()
        one.begin(n_steps=3)
        one.give(Command.KEEP_FAILURE)
        assert one.status.question == "99 %, flat: keep as failure?"
        one.give(Command.DISCARD)
        assert one.state == "waiting"
        one.give(Command.UNDO)
        assert (one.state, one.status.question) == ("paused", "")

    def test_an_answer_without_a_question_changes_nothing(self, record):
        one = record()
        one.begin(n_steps=1)
        one.session.answer(True)
        assert (one.state, one.message) == ("running", "there is no question to answer now")


class TestPlacing:
    """A policy places, and the cloth is disturbed."""

    @pytest.fixture
    def placing(self, record) -> Recording:
        one = record(policy=True, source="", session=None)
        one.session.update()
        assert one.step(AT_REST, 3) == 3
        return one

    def test_it_starts_by_itself_and_says_how_it_stopped(self, placing):
        assert (placing.status.mode, placing.message, placing.status.controller) == ("place", "hold places", "hold")
        placing.episode.verdict, placing.episode.stops = FOLDED, {5: "threshold"}
        assert placing.step(AT_REST, 9) == 2
        assert placing.state == "stopped"
        message = placing.status.message
        assert (message.text, message.level) == ("Stopped: 77 %, folded over at the free edge", "warning")

    def test_only_a_success_is_placed(self, placing):
        placing.episode.stops = {5: "converged"}
        placing.step(AT_REST, 9)
        assert placing.status.message == Message(text="Placed: 99 %, flat", level="success")

    def test_motion_without_a_device_changes_nothing(self, placing):
        placing.step(FORWARD, 2)
        placing.step(DISCONNECTED, 2)
        assert placing.n_steps == 7
        assert not any(teleop.moving for teleop in placing.episode.inputs)

    def test_a_disturbance_after_the_stop_is_waited_for_and_repaired(self, placing):
        placing.episode.stops = {3: "threshold"}
        placing.step(AT_REST, 2)
        placing.session.disturb("push")
        assert placing.message == "disturbance: push"
        placing.step(AT_REST, 2)
        placing.now += NOTE_S
        assert placing.status.phase == "disturb"
        assert placing.message == "hold waits until the cloth has settled"
        placing.episode.stops = {8: "threshold"}
        placing.step(AT_REST, 9)
        assert placing.episode.phases == ["place"] * 3 + ["disturb"] * 3 + ["repair"] * 2
        assert (placing.state, placing.episode.proceeded) == ("stopped", 1)

    def test_a_drag_disturbs_until_the_cloth_has_settled(self, placing):
        placing.episode.stops = {3: "threshold"}
        placing.step(AT_REST, 2)
        assert placing.step(AT_REST, 3, PULL) == 3
        assert placing.status.dragging
        assert placing.message == "you pull at the cloth"
        placing.episode.stops = {3: "threshold", 20: "threshold"}
        placing.step(AT_REST, 30)
        assert placing.episode.phases == ["place"] * 3 + ["disturb"] * (3 + SETTLE_STEPS) + ["repair"] * 4
        assert placing.status.drag_steps == 3
        assert placing.message == "Placed: 99 %, flat"

    def test_a_stop_while_the_cloth_is_disturbed_is_waited_for(self, placing):
        placing.session.disturb("push")
        placing.episode.stops = {4: "threshold"}
        placing.step(AT_REST, 2)
        assert placing.status.phase == "disturb"

    def test_nothing_can_be_kept_without_a_file(self, placing):
        for command in (Command.KEEP_SUCCESS, Command.KEEP_FAILURE):
            placing.give(command)
            assert "nothing is recorded" in placing.message
        assert placing.status.effect(Command.DISCARD) == "next seed"
        placing.give(Command.DISCARD)
        assert (placing.status.seed, placing.lines) == (1, [])
        placing.step(AT_REST, 3)
        assert placing.n_steps >= 2

    def test_its_steps_are_limited(self, record):
        one = record(policy=True, source="", session=None)
        one.episode.limits = StepLimits(place=4)
        one.session.update()
        assert one.step(AT_REST, 9) == 4
        assert (one.state, one.status.stopped_by) == ("stopped", "step_limit")

    def test_fast_forward_ends_when_it_has_stopped(self, record):
        one = record(policy=True, source="", session=None, fast_forward=True)
        one.episode.stops = {20: "converged"}
        for _ in range(60):
            one.session.update()
        assert (one.now, one.n_steps, one.state) == (0.0, 20, "stopped")
        one.give(Command.DISTURB)
        for _ in range(20):
            one.session.update()
        assert one.n_steps == 21, "the next step is only due after 0.1 s"


class TestCorrection:
    """A policy places, and the person takes over."""

    @pytest.fixture
    def running(self, record) -> Recording:
        one = record(policy=True)
        one.begin()
        return one

    def test_time_waits_for_nothing_while_the_policy_is_in_control(self, running):
        assert running.state == "running"
        assert running.step(AT_REST, 5) == 5
        running.give(Command.PAUSE)
        assert running.step(AT_REST, 5) == 0
        running.give(Command.PAUSE)
        assert running.step(AT_REST, 2) == 2

    def test_after_the_policy_has_stopped_time_waits_for_motion(self, running):
        running.episode.stops = {2: "threshold"}
        assert running.step(AT_REST, 6) == 2
        assert running.message == "Placed: 99 %, flat; move to continue yourself"
        assert running.status.effect(Command.KEEP_SUCCESS)
        assert running.step(FORWARD) == 1
        assert "you are in control" in running.message
        assert running.step(AT_REST) == 1

    def test_it_says_who_is_in_control_and_a_button_returns_it(self, running):
        assert running.step(AT_REST, 2) == 2
        assert running.message == "hold places; move to take over"
        assert running.status.effect(Command.START) is None
        assert running.step(FORWARD) == 1
        assert running.status.controller == YOU
        assert running.status.effect(Command.START) == "return control to hold"
        running.session.handle_input(AT_REST)
        running.give(Command.START)
        running.step(AT_REST)
        assert running.status.controller == "hold"

    def test_a_disconnected_device_pauses_the_correction(self, running):
        assert running.step(FORWARD, 2) == 2
        assert running.step(DISCONNECTED) == 0
        assert running.message == DISCONNECTED.problem
        running.session.handle_input(AT_REST)
        assert running.state == "running"
        assert running.step(AT_REST, 2) == 2

    def test_without_the_device_the_policy_continues_on_request(self, running):
        running.step(AT_REST, 2)
        running.step(DISCONNECTED)
        running.give(Command.PAUSE)
        assert running.step(DISCONNECTED, 2) == 2
        running.give(Command.PAUSE)
        assert running.step(AT_REST, 3) == 0  # A reconnected device does not undo a pause of the person.

    def test_a_motion_ends_the_wait_after_a_disturbance(self, running):
        running.episode.stops = {2: "threshold"}
        running.step(AT_REST, 4)
        running.give(Command.DISTURB)
        running.step(AT_REST, 1)
        running.step(FORWARD, 3)
        assert running.episode.phases == ["place"] * 2 + ["disturb"] + ["repair"] * 3

    def test_the_limit_of_the_policy_does_not_end_a_correction(self, running):
        running.episode.status = replace(running.episode.status, limits=StepLimits(place=5))
        running.episode.limits = StepLimits(place=5)
        running.step(AT_REST, 3)
        assert running.step(FORWARD, 10) == 10

    def test_a_kept_take_has_the_persons_or_the_policys_reason(self, running, tmp_path):
        running.step(FORWARD, 2)
        running.give(Command.KEEP_SUCCESS)
        running.begin()
        running.episode.stops = {2: "threshold"}
        running.step(AT_REST, 3)
        running.give(Command.KEEP_SUCCESS)
        running.close()
        assert [row[3] for row in outcomes(tmp_path / "s.h5")] == ["converged", "threshold"]


def test_what_has_happened_is_said_for_a_moment(record):
    one = record()
    one.begin(n_steps=2)
    one.give(Command.START)
    assert one.status.message == Message(text="nothing to start now", level="warning")
    one.now += NOTE_S
    assert one.message == "recording"


def test_a_note_of_the_request_is_the_first_message(record):
    note = Message(text="no gamepad is plugged in; the keyboard is used instead", level="warning")
    assert record(note=note).status.message == note


ACTS = [*Command, "move", "rest", "wait", "pull", "disconnect", "yes", "no", "push", "hold", "stop", "die"]


@settings(max_examples=150, deadline=None)
@given(
    acts=st.lists(st.sampled_from(ACTS), max_size=30),
    mode=st.sampled_from(["record", "correct", "place"]),
    verdict=st.sampled_from([FLAT, FOLDED]),
    recorded=st.booleans(),
)
def test_nothing_is_lost_and_effects_are_true_after_any_acts(tmp_path_factory, acts, mode, verdict, recorded):
    """A command with an effect has one, every other changes nothing; lines and files agree; every state is left."""
    path = tmp_path_factory.mktemp("any") / "s.h5"
    file = path if recorded or mode == "record" else None
    one = Recording(file, policy=mode != "record", source="" if mode == "place" else "keyboard")
    one.verdict = one.episode.verdict = verdict
    saves: list[tuple[str, int]] = []

    def snapshot() -> tuple[object, ...]:
        status, held = one.status, one.episodes
        disturbed = sum(len(episode.disturbances) for episode in one.episodes)
        return status.state, status.seed, len(held), status.counts, len(one.lines), disturbed, status.controller

    for act in acts:
        episode = one.episode
        if isinstance(act, Command):
            before, effect, steps = snapshot(), one.status.effect(act), one.n_steps
            one.session.handle_command(act)
            done = before != snapshot() or act is Command.START
            assert done if effect is not None else before == snapshot()
            if effect is not None and "keep as" in effect and one.state != "asking":
                saves.append(("success" if act is Command.KEEP_SUCCESS else "failure", steps))
        elif act == "die" and not episode.gone and episode.status is not None and episode.inputs:
            episode.dies_at = len(episode.inputs)
        elif act == "stop":
            episode.stops = {len(episode.inputs) + 1: "threshold"} if mode != "record" else {}
        elif act == "hold":
            episode.holds = not episode.holds
        elif act in ("yes", "no"):
            if act == "yes" and one.status.asked is not None:
                saves.append((one.status.asked, one.n_steps))
            one.session.answer(act == "yes")
        elif act == "push":
            one.session.disturb("push")
        elif act == "wait":
            one.now += COUNTDOWN_S
        else:
            teleop = {"move": FORWARD, "disconnect": DISCONNECTED}.get(act, AT_REST)
            one.step(teleop, 2, PULL if act == "pull" else None)
        one.session.update()
    for episode in one.episodes:
        episode.holds = False
    one.close()
    one.close()
    assert all(episode.gone for episode in one.episodes)
    kept = [line.split() for line in one.lines if line.startswith("kept")]
    found = outcomes(path) if kept else []
    assert [(outcome, n_steps) for _, outcome, n_steps, _ in found] == [(words[2], int(words[3])) for words in kept]
    assert file is None or n_episodes(path) == len(kept)
    # Every take that has steps is kept, or was discarded for good and said so.
    with_steps = [episode for episode in one.episodes if episode.inputs]
    discarded = sum(line.startswith("discarded") for line in one.lines)
    assert file is None or len(with_steps) == len(kept) + discarded
    labelled = [(words[2], int(words[3])) for words in kept if words[2] != "partial"]
    assert len(labelled) <= len(saves)
    assert np.isin([label for label, _ in labelled], [label for label, _ in saves]).all()
