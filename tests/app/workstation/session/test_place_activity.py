"""PlaceActivity: who is in control, what is marked, and what is saved when a person takes over."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from layflat.app.workstation.session.activity_process import Channels, Endpoint, receive
from layflat.app.workstation.session.place_activity import PlaceActivity
from layflat.app.workstation.session.requests import PlaceRequest
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput, zero_input
from layflat.data.session.reader import open_session
from layflat.data.tools.validate import validate
from layflat.data.types import ACTION_LIMIT_M, DragTarget, Episode
from layflat.policy.wrappers.takeover import REST_STEPS
from layflat.sim.config import SimConfig
from layflat.tests.app.workstation.fake_placing import FakePolicySpec, FlatEnvironment
from layflat.tests.factories import HANGER
from layflat.tests.fake_environment import ForwardPolicy

PUSH = TeleopInput(motion=np.array([-1.0, 0.0]), speed=0.5, device="a gamepad")
REST = zero_input(HANGER, device="a gamepad")
LOST = zero_input(HANGER, connected=False, problem="a gamepad was disconnected; plug it in again")


class Placing:
    """An activity without physics, and the window's end of its channels."""

    def __init__(
        self,
        session: Path | None = None,
        *,
        source: str = "gamepad",
        enough: float = 2.0,
        wrappers: tuple[str, ...] = (),
        max_steps: int = 160,
        **options,
    ) -> None:
        context = get_context("spawn")
        self.channels = Channels(context)
        self._connection, theirs = context.Pipe()
        self.policy = ForwardPolicy(enough)
        request = PlaceRequest(
            **({"sim_config": SimConfig(robot="hanger"), "seed": 3, "speed": 0.0} | options),
            source=source, session=session, policy=FakePolicySpec(self.policy, wrappers),
        )  # fmt: skip
        endpoint = Endpoint(channels=self.channels, connection=theirs)
        self.activity = PlaceActivity(request, endpoint, make_env=partial(FlatEnvironment, place=max_steps))
        self.request("start")

    @property
    def status(self) -> dict:
        return self.activity.status()

    @property
    def n_steps(self) -> int:
        return self.activity.run.n_steps

    def request(self, request: str, **values: str) -> None:
        self.activity.handle_request({"request": request, **values})

    def command(self, command: Command) -> None:
        self.request("command", name=command.name)

    def step(self, teleop: TeleopInput, rounds: int = 1, drag: DragTarget | None = None) -> int:
        """Return how many steps came of so many rounds with this input."""
        before = self.n_steps
        self.channels.inputs.write(teleop, drag)
        for _ in range(rounds):
            self.activity.step()
        return self.n_steps - before

    def marked(self) -> list[bool]:
        return [step.intervention for step in self.activity.run.steps]

    def events(self) -> list[dict]:
        found = []
        while self._connection.poll():
            found.append(receive(self._connection))
        return found


@pytest.fixture
def place() -> Iterator[Callable[..., Placing]]:
    made: list[Placing] = []

    def make(*arguments, **options) -> Placing:
        made.append(Placing(*arguments, **options))
        return made[-1]

    yield make
    for each in made:
        each.activity.close()


def the_episode(path: Path) -> Episode:
    assert validate(path) == ()
    with open_session(path) as session:
        (name,) = session.names
        return session.episode(name)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(moves=st.lists(st.booleans(), min_size=1, max_size=40))
def test_the_person_is_in_control_from_the_first_motion_until_they_have_rested(place, moves):
    """A step is the person's where they moved in it or in one of the seven before."""
    one = place()
    for moving in moves:
        assert one.step(PUSH if moving else REST) == 1
        expected = any(moves[max(0, one.n_steps - REST_STEPS) : one.n_steps])
        assert (one.status["controller"] == "you") is expected
        assert one.channels.frames.read()[1].human_in_control is expected
    human = [any(moves[max(0, k - REST_STEPS + 1) : k + 1]) for k in range(len(moves))]
    assert one.marked() == human
    # The person's action is carried out where they are in control, and else the policy's.
    done = [float(step.action[0]) for step in one.activity.run.steps]
    wanted = [(-0.5 * ACTION_LIMIT_M if moves[k] else 0.0) if mine else 0.01 for k, mine in enumerate(human)]
    assert done == pytest.approx(wanted)


def test_a_change_of_control_is_shown(place):
    one = place()
    one.step(REST, 3)
    assert one.status["controller"] == "forward"
    one.step(PUSH, 2)
    assert one.status["message"] == "you are in control; stop moving to return control to forward"
    one.step(REST, REST_STEPS)
    assert one.status["message"] == "forward is in control"
    assert one.status["intervention_steps"] == sum(one.marked()) == 2 + REST_STEPS - 1


def test_a_button_returns_control_at_once(place):
    one = place()
    assert one.activity.effect(Command.START) is None
    one.step(PUSH, 2)
    assert one.activity.effect(Command.START) == "return control to forward"
    one.step(REST)
    one.command(Command.START)
    one.step(REST)
    assert one.marked() == [True, True, True, False]
    # A person who still moves keeps it.
    one.step(PUSH)
    one.command(Command.START)
    one.step(PUSH)
    assert one.marked()[-2:] == [True, True]


def test_a_disconnected_device_pauses_as_in_a_recording(place):
    one = place()
    one.step(REST)
    one.step(PUSH, 2)
    assert one.step(LOST, 5) == 0
    assert (one.status["paused"], one.status["controller"]) == (True, "")
    assert one.status["message"] == f"paused: {LOST.problem}"
    assert one.step(REST) == 1
    assert "a gamepad is connected again" in one.status["message"]
    # Their correction continues until they have rested.
    assert one.status["controller"] == "you"


def test_without_the_device_the_policy_continues_on_request(place):
    one = place()
    one.step(PUSH, 2)
    one.step(LOST)
    one.request("pause")
    assert one.step(LOST, 2) == 2
    assert one.marked() == [True, True, False, False]
    assert one.status["message"] == "forward is in control"
    assert one.policy.continued == 1
    # A reconnected device does not undo a pause of the person.
    one.request("pause")
    assert one.step(REST, 3) == 0


def test_after_the_policy_has_stopped_time_waits_for_motion(place):
    one = place(enough=0.1)
    one.step(REST, 30)
    assert one.status["state"] == "placed"
    assert "move to continue yourself" in one.status["message"]
    at = one.n_steps
    assert one.step(REST, 5) == 0
    assert one.step(PUSH, 4) == 4
    assert one.status["controller"] == "you"
    # In control again, the policy continues from where the person has moved the robot.
    one.step(REST, 60)
    assert one.status["state"] == "placed"
    assert one.marked()[at:] == [True] * (4 + REST_STEPS - 1) + [False] * (one.n_steps - at - 4 - REST_STEPS + 1)
    assert not one.marked()[-1]
    assert {step.phase for step in one.activity.run.steps} == {"place"}


def test_a_correction_after_a_disturbance_is_the_repair(place):
    one = place(enough=0.1)
    one.step(REST, 30)
    one.command(Command.DISTURB)
    one.step(REST, 2)
    assert one.status["state"] == "disturbing"
    one.step(PUSH, 3)
    assert one.status["state"] == "repairing"
    assert [(step.phase, step.intervention) for step in one.activity.run.steps[-5:]] == [
        ("disturb", False), ("disturb", False), ("repair", True), ("repair", True), ("repair", True),
    ]  # fmt: skip


def test_a_drag_disturbs_a_placed_cloth_until_it_has_settled(place):
    one = place(enough=0.1)
    one.step(REST, 30)
    one.step(REST, 3, DragTarget(node=0, target_m=[0.1, 0.0, 0.1]))
    assert (one.status["state"], one.status["drag_steps"]) == ("disturbing", 3)
    one.step(REST, 40)
    assert one.status["state"] == "placed"
    assert {step.phase for step in one.activity.run.steps} == {"place", "disturb", "repair"}
    assert sum(step.drag is not None for step in one.activity.run.steps) == 3


def test_wrappers_may_have_steps_of_their_own(place):
    """The step limit is raised by what the wrapper says that it may need."""
    bare, wrapped = (place(source="", max_steps=4, wrappers=names) for names in ((), ("recovery", "steady")))
    for each in (bare, wrapped):
        each.step(REST, 30)
    assert (bare.status["state"], bare.n_steps) == ("placed", 4)
    assert wrapped.status["state"] == "placing"
    assert wrapped.status["policy"] == f"{bare.status['policy']}+recovery+steady"
    assert wrapped.n_steps == 30


def test_the_step_limit_of_the_policy_does_not_end_a_correction(place):
    one = place(max_steps=5)
    one.step(REST, 3)
    assert one.step(PUSH, 10) == 10
    one.step(REST, REST_STEPS + 3)
    assert one.status["state"] == "placed"


@pytest.mark.parametrize(("command", "outcome"), [(Command.KEEP_SUCCESS, "success"), (Command.KEEP_FAILURE, "failure")])
def test_a_saved_episode_marks_the_steps_of_the_person(place, tmp_path, command, outcome):
    path = tmp_path / "s.h5"
    one = place(path)
    one.step(REST, 2)
    one.step(PUSH, 3)
    marked = one.marked()
    one.command(command)
    assert one.activity.done
    (saved,) = [event for event in one.events() if event["event"] == "saved"]
    assert saved["line"].startswith(f"kept demo_0 {outcome} 5 steps contact ")
    one.activity.close()
    episode = the_episode(path)
    assert (episode.source, episode.outcome, episode.stopped_by) == ("forward+gamepad", outcome, "converged")
    assert [step.intervention for step in episode.steps] == marked == [False] * 2 + [True] * 3
    assert [path.name for path in tmp_path.iterdir() if path.suffix != ".parts"] == ["s.h5"]


def test_an_episode_saved_in_a_correction_was_not_ended_by_the_policy(place, tmp_path):
    path = tmp_path / "s.h5"
    one = place(path, enough=0.1)
    one.step(REST, 30)
    assert "stopped by converged" in one.status["message"]
    one.step(PUSH, 2)
    one.request("save")
    one.activity.close()
    assert the_episode(path).stopped_by == "interrupted"


def test_an_episode_without_a_verdict_is_saved_as_partial_with_its_marks(place, tmp_path):
    path = tmp_path / "s.h5"
    one = place(path)
    one.step(PUSH, 6)
    one.command(Command.QUIT)
    assert one.activity.done
    one.activity.close()
    episode = the_episode(path)
    assert episode.outcome == "partial"
    # The journal's last step is the end of the one before.
    assert [step.intervention for step in episode.steps] == [True] * 5


def test_without_a_session_nothing_can_be_kept(place):
    one = place()
    one.step(PUSH)
    for command in (Command.KEEP_SUCCESS, Command.KEEP_FAILURE, Command.DISCARD):
        assert one.activity.effect(command) is None
        one.command(command)
        assert "nothing is recorded" in one.status["message"]
    one.command(Command.REDO)
    assert one.status["message"] == "nothing to redo now"
    assert not one.activity.done


def test_a_diverged_simulation_is_no_success(place, tmp_path):
    one = place(tmp_path / "s.h5")
    one.activity.env.diverges_at = 3
    one.step(PUSH, 5)
    assert one.status["state"] == "over"
    assert one.activity.effect(Command.KEEP_SUCCESS) is None
    assert one.activity.effect(Command.KEEP_FAILURE) == "keep as failure"


def test_without_a_device_the_person_cannot_take_over(place):
    one = place(source="")
    one.step(PUSH, 5)
    one.step(LOST, 5)
    assert not any(one.marked())
    assert (one.n_steps, one.status["controller"], one.status["effects"]) == (10, "", {})


def test_fast_forward_ends_when_the_cloth_is_placed(place):
    one = place(enough=0.1, speed=1.0, fast_forward=True)
    one.step(REST, 30)
    assert one.status["state"] == "placed"
    one.command(Command.DISTURB)
    assert one.step(REST, 5) == 1, "the next step is only due after 0.1 s"
