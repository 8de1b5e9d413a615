"""A person takes over from what places in the window: who leads, what is marked, and what is in the file."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pygame
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from layflat.app.workstation.session import place_task
from layflat.app.workstation.session.bench_process import Channels, Endpoint, receive
from layflat.app.workstation.session.place_task import PlaceTask
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput, zero_input
from layflat.app.workstation.window import style
from layflat.app.workstation.window.playback import Playback
from layflat.app.workstation.window.time_series import LEAST_S, TimeSeries, draw_contact
from layflat.data import validate
from layflat.data.session.reader import open_session
from layflat.data.types import ACTION_LIMIT_M, DragTarget
from layflat.policy.registry import wrap
from layflat.policy.wrappers.takeover import REST_STEPS
from layflat.sim.robots.registry import robot_spec
from layflat.tests.fake_environment import FakeEnvironment, ForwardPolicy

PUSH = TeleopInput(motion=np.array([-1.0, 0.0]), speed=0.5, device="a pad")
REST = zero_input(robot_spec("hanger"), device="a pad")
GONE = zero_input(robot_spec("hanger"), connected=False, problem="a pad is gone; plug it in again")


class Table:
    """A placing whose bench is a few numbers, and the window's end of its channels."""

    def __init__(self, record: Path | None, source: str, policy: ForwardPolicy, around: tuple[str, ...] = ()) -> None:
        context = get_context("spawn")
        self.channels = Channels(context, robot_spec("hanger"))
        self._connection, theirs = context.Pipe()
        self.policy = policy
        order = {
            "robot": "hanger", "cloth": "towel", "descriptor": "word-axial", "noise": True, "step_s": 0.1, "speed": 0.0,
            "seed": 3, "policy": "scripted", "record": "" if record is None else str(record), "source": source,
            "with": list(around),
        }  # fmt: skip
        self.work = PlaceTask(order, Endpoint(channels=self.channels, connection=theirs))
        self.work.obey({"do": "start"})

    @property
    def status(self) -> dict:
        return self.work.status()

    @property
    def n_steps(self) -> int:
        return self.work.run.n_steps

    def go(self, reading: TeleopInput, rounds: int = 1, pull: DragTarget | None = None) -> int:
        """So many rounds of the bench with this in the mailbox; returns how many steps came of it."""
        before = self.n_steps
        self.channels.mailbox.put(reading, pull)
        for _ in range(rounds):
            self.work.advance()
        return self.n_steps - before

    def press(self, control: Command) -> None:
        self.work.obey({"do": "control", "name": control.name})

    def marked(self) -> list[bool]:
        return [step.intervention for step in self.work.run.steps]

    def heard(self) -> list[dict]:
        found = []
        while self._connection.poll():
            found.append(receive(self._connection))
        return found


@pytest.fixture
def table(monkeypatch) -> Iterator[Callable[..., Table]]:
    made: list[Table] = []

    def make(
        record: Path | None = None, *, source: str = "gamepad", enough: float = 2.0, around: tuple[str, ...] = ()
    ) -> Table:
        policy = ForwardPolicy(enough)
        monkeypatch.setattr(place_task, "Placing", FakeEnvironment)
        monkeypatch.setattr(place_task, "policy_of", lambda job, bench: wrap(policy, job.decorators))
        made.append(Table(record, source, policy, around))
        return made[-1]

    yield make
    for each in made:
        each.work.close()


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(moves=st.lists(st.booleans(), min_size=1, max_size=40))
def test_who_moves_leads_in_that_very_step_and_until_they_have_rested(table, moves):
    """Whatever the hands do: a step is the person's where they moved in it or in one of the seven before."""
    one = table()
    for moving in moves:
        assert one.go(PUSH if moving else REST) == 1
        expected = any(moves[max(0, one.n_steps - REST_STEPS) : one.n_steps])
        assert (one.status["leads"] == "you") is expected
        moment = one.channels.moments.read()[1]
        assert moment.led is expected
    theirs = [any(moves[max(0, k - REST_STEPS + 1) : k + 1]) for k in range(len(moves))]
    assert one.marked() == theirs
    # Where the person leads it is done what they do, and else what the policy decides.
    done = [float(step.action[0]) for step in one.work.run.steps]
    wanted = [(-0.5 * ACTION_LIMIT_M if moves[k] else 0.0) if led else 0.01 for k, led in enumerate(theirs)]
    assert done == pytest.approx(wanted)


def test_the_lead_is_said_when_it_changes_hands(table):
    one = table()
    one.go(REST, 3)
    assert one.status["leads"] == "forward"
    one.go(PUSH, 2)
    assert one.status["message"] == "you have the lead; rest, and forward has it again"
    one.go(REST, REST_STEPS)
    assert one.status["message"] == "forward has the lead again"
    assert one.status["led_steps"] == sum(one.marked()) == 2 + REST_STEPS - 1


def test_a_button_hands_back_at_once(table):
    one = table()
    assert one.work.does(Command.START) is None
    one.go(PUSH, 2)
    assert one.work.does(Command.START) == "hand back to forward"
    one.go(REST)
    one.press(Command.START)
    one.go(REST)
    assert one.marked() == [True, True, True, False]
    # Who has not let go of the stick has not handed back.
    one.go(PUSH)
    one.press(Command.START)
    one.go(PUSH)
    assert one.marked()[-2:] == [True, True]


def test_a_pad_unplugged_in_a_correction_pauses_as_in_a_recording(table):
    one = table()
    one.go(REST)
    one.go(PUSH, 2)
    assert one.go(GONE, 5) == 0
    assert one.status["paused"]
    assert one.status["leads"] == ""
    assert one.status["message"] == f"paused: {GONE.problem}"
    assert one.go(REST) == 1
    assert "a pad is back" in one.status["message"]
    # What they had begun goes on until they have rested.
    assert one.status["leads"] == "you"


def test_without_the_pad_the_policy_goes_on_where_one_says_so(table):
    one = table()
    one.go(PUSH, 2)
    one.go(GONE)
    one.work.obey({"do": "pause"})
    assert one.go(GONE, 2) == 2
    assert one.marked() == [True, True, False, False]
    assert one.status["message"] == "forward has the lead again"
    assert one.policy.resumed == 1
    # And the person may pause; a pad that is back does not undo that.
    one.work.obey({"do": "pause"})
    assert one.go(REST, 3) == 0


def test_after_the_stop_time_stands_until_the_hands_move(table):
    one = table(enough=0.1)
    one.go(REST, 30)
    assert one.status["state"] == "placed"
    assert "move to go on yourself" in one.status["message"]
    at = one.n_steps
    assert one.go(REST, 5) == 0
    assert one.go(PUSH, 4) == 4
    assert one.status["leads"] == "you"
    # Handed back, the policy goes on from where the person has led it.
    one.go(REST, 60)
    assert one.status["state"] == "placed"
    assert one.marked()[at:] == [True] * (4 + REST_STEPS - 1) + [False] * (one.n_steps - at - 4 - REST_STEPS + 1)
    assert not one.marked()[-1]
    assert {step.phase for step in one.work.run.steps} == {"place"}


def test_after_a_disturbance_what_the_person_leads_is_the_repair(table):
    one = table(enough=0.1)
    one.go(REST, 30)
    one.press(Command.DISTURB)
    one.go(REST, 2)
    assert one.status["state"] == "disturbing"
    one.go(PUSH, 3)
    assert one.status["state"] == "repairing"
    assert [(step.phase, step.intervention) for step in one.work.run.steps[-5:]] == [
        ("disturb", False), ("disturb", False), ("repair", True), ("repair", True), ("repair", True),
    ]  # fmt: skip


def test_what_recovers_has_the_steps_that_recovering_takes(table, monkeypatch):
    """The limit of a placing is longer by what the decorator says that it may need."""
    monkeypatch.setitem(place_task.LIMIT_STEPS, "placing", 4)
    bare, around = table(source=""), table(source="", around=("recovery", "steady"))
    for each in (bare, around):
        each.go(REST, 30)
    assert bare.status["state"] == "placed"
    assert around.status["state"] == "placing"
    assert around.status["policy"] == f"{bare.status['policy']}+recovery+steady"
    assert around.n_steps == 30


def test_who_leads_is_not_cut_off_by_the_limit_of_the_policy(table, monkeypatch):
    monkeypatch.setitem(place_task.LIMIT_STEPS, "placing", 5)
    one = table()
    one.go(REST, 3)
    assert one.go(PUSH, 10) == 10
    one.go(REST, REST_STEPS + 3)
    assert one.status["state"] == "placed"


@pytest.mark.parametrize(("control", "outcome"), [(Command.KEEP_SUCCESS, "success"), (Command.KEEP_FAILURE, "failure")])
def test_what_is_kept_says_which_steps_were_the_person_s(table, tmp_path, control, outcome):
    path = tmp_path / "s.h5"
    one = table(path)
    one.go(REST, 2)
    one.go(PUSH, 3)
    marked = one.marked()
    one.press(control)
    assert one.work.over
    (kept,) = [message for message in one.heard() if message["kind"] == "kept"]
    assert kept["line"].startswith(f"kept demo_0 {outcome} 5 steps contact ")
    one.work.close()
    assert validate(path) == ()
    with open_session(path) as session:
        episode = session[0]
    assert (episode.source, episode.outcome, episode.stopped_by) == ("forward+gamepad", outcome, "converged")
    assert [step.intervention for step in episode.steps] == marked == [False] * 2 + [True] * 3
    assert [path.name for path in tmp_path.iterdir() if path.suffix != ".parts"] == ["s.h5"]


def test_what_is_kept_in_the_midst_of_a_correction_was_not_ended_by_the_policy(table, tmp_path):
    path = tmp_path / "s.h5"
    one = table(path, enough=0.1)
    one.go(REST, 30)
    assert "stopped by converged" in one.status["message"]
    one.go(PUSH, 2)
    one.work.obey({"do": "keep"})
    one.work.close()
    with open_session(path) as session:
        assert session[0].stopped_by == "interrupted"


def test_what_nobody_judges_is_kept_as_partial_with_its_marks(table, tmp_path):
    path = tmp_path / "s.h5"
    one = table(path)
    one.go(PUSH, 6)
    one.press(Command.QUIT)
    assert one.work.over
    one.work.close()
    with open_session(path) as session:
        assert session[0].outcome == "partial"
        marked = [step.intervention for step in session[0].steps]
    # The journal's last step is the end of the one before.
    assert marked == [True] * 5


def test_where_nothing_is_recorded_keeping_is_a_sentence(table):
    one = table()
    one.go(PUSH)
    for control in (Command.KEEP_SUCCESS, Command.KEEP_FAILURE, Command.DISCARD):
        assert one.work.does(control) is None
        one.press(control)
        assert "nothing is recorded" in one.status["message"]
    one.press(Command.REDO)
    assert one.status["message"] == "there is nothing to redo now"
    assert not one.work.over


def test_a_cloth_that_came_apart_is_no_success(table, tmp_path):
    one = table(tmp_path / "s.h5")
    one.work.bench.diverges_at = 3
    one.go(PUSH, 5)
    assert one.status["state"] == "over"
    assert one.work.does(Command.KEEP_SUCCESS) is None
    assert one.work.does(Command.KEEP_FAILURE) == "keep as failure"


def test_without_a_device_nobody_takes_over(table):
    one = table(source="")
    one.go(PUSH, 5)
    one.go(GONE, 5)
    assert not any(one.marked())
    assert (one.n_steps, one.status["leads"], one.status["does"]) == (10, "", {})


def band(history: TimeSeries, width: int = 300) -> np.ndarray:
    """Of each second's middle: whether the band of the person's lead is below the curve."""
    pygame.font.init()
    style.fresh()
    surface = pygame.Surface((width, 160))
    draw_contact(surface, history)
    seen = (pygame.surfarray.array3d(surface) == style.LED).all(axis=2).any(axis=1)
    left, right = 42, width - 14  # Of the plot on its card.
    return seen[[round(left + (s + 0.5) / LEAST_S * (right - left - 1)) for s in range(int(LEAST_S))]]


@given(st.lists(st.booleans(), min_size=10, max_size=10))
@settings(max_examples=20, deadline=None)
def test_the_curves_show_when_the_person_led(led):
    """A step a second, so that each has its own place."""
    history = TimeSeries(
        episode=1,
        time_s=[float(s) for s in range(11)],
        contact=[0.5] * 11,
        angle_deg=[np.nan] * 11,
        phase=["place"] * 11,
        led=[False, *led],
    )
    assert band(history).tolist() == led


def test_a_replay_shows_what_was_marked(lying, make_episode):
    episode = lying(make_episode(disturbed=False))
    marks = [False, True, True, False, False, True]
    steps = tuple(replace(step, intervention=mark) for step, mark in zip(episode.steps, marks, strict=True))
    shown = Playback("s.h5 demo_0", replace(episode, steps=steps))
    assert [shown.moment(k).led for k in range(7)] == [False, *marks]
    assert ["a person leads" in shown.befalls(k) for k in range(6)] == marks
