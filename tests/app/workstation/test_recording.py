"""The state machine of recording over drawn takes, and into real sessions."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from layflat.app.workstation.session.episode_handle import EpisodeLost
from layflat.app.workstation.session.recording_session import COUNTDOWN_S, RecordingSession
from layflat.app.workstation.session.session_queries import recorded_seeds, stored
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput
from layflat.data.session.reader import open_session
from layflat.data.session.recorder import SessionRecorder
from layflat.data.types import Episode, GroundTruth, Observation, Step
from layflat.tests.app.workstation.conftest import DrawnTake

KEPT = re.compile(r"kept demo_\d+ (success|failure|partial) \d+ steps contact [01]\.\d\d \S+")
DISCARDED = re.compile(r"discarded seed \d+ \d+ steps contact [01]\.\d\d \S+")


def draw(robot: str, *, n_steps: int, seed: int, cloth: str, source: str) -> Episode:
    """An episode of zeros."""
    size = 2 if robot == "hanger" else 6
    seen = Observation(
        time_s=0.0,
        corner_positions=np.zeros((2, 3)),
        holder_position=np.zeros(3),
        word=np.zeros(2),
        word_strength=0.0,
        contact_portion=0.5,
    )
    ground_truth = GroundTruth(nodes=np.zeros((4, 3)), contact_portion_true=0.5, flat_area=0.5)
    steps = tuple(Step(observation=seen, ground_truth=ground_truth, action=np.zeros(size)) for _ in range(n_steps))
    return Episode(
        robot=robot,
        cloth=cloth,
        seed=seed,
        source=source,
        steps=steps,
        final_observation=seen,
        final_ground_truth=ground_truth,
        stopped_by="converged",
        outcome="success",
    )


class Desk:
    """A recording with all that a test wants to look at."""

    def __init__(self, path: Path, **options) -> None:
        self.now = 0.0
        self.lines: list[str] = []
        self.takes: list[DrawnTake] = []
        self.recorder = SessionRecorder(path, robot="hanger", cloth="towel")
        self.recording = RecordingSession(
            self.recorder, self._begin, tell=self.lines.append, clock=lambda: self.now, **options
        )

    def _begin(self, seed: int) -> DrawnTake:
        self.takes.append(DrawnTake(seed, self.recorder, draw))
        return self.takes[-1]

    @property
    def state(self) -> str:
        return self.recording.state

    def press(self, *controls: Command) -> None:
        self.recording.hear(TeleopInput(motion=np.zeros(2), controls=controls))

    def move(self, n_steps: int) -> int:
        """So many steps of motion; returns how many were simulated."""
        self.recording.hear(TeleopInput(motion=np.array([1.0, 0.0])))
        return sum(self.recording.step() for _ in range(n_steps))

    def begin(self, n_steps: int = 0) -> None:
        """Through the countdown."""
        self.press(Command.START)
        self.now += COUNTDOWN_S
        self.recording.step()
        assert self.state == "running"
        self.move(n_steps)

    def close(self) -> None:
        self.recording.close()
        self.recorder.close()


@pytest.fixture
def desk(tmp_path) -> Iterator[Callable[..., Desk]]:
    made: list[Desk] = []

    def make(**options) -> Desk:
        made.append(Desk(tmp_path / "s.h5", **options))
        return made[-1]

    yield make
    for each in made:
        each.close()


def outcomes(path: Path) -> list[tuple[int, str, int]]:
    with open_session(path) as session:
        return [(info.seed, info.outcome, info.n_steps) for info in session.infos().values()]


def test_kept_discarded_and_done_again(desk, tmp_path):
    one = desk(seed=4)
    one.begin(n_steps=3)
    one.press(Command.KEEP_SUCCESS)
    one.begin(n_steps=2)
    one.press(Command.DISCARD)
    one.begin(n_steps=5)
    one.press(Command.REDO)
    assert (one.state, one.recording.seed) == ("countdown", 6)
    one.now += COUNTDOWN_S
    one.recording.step()
    one.move(7)
    one.press(Command.KEEP_FAILURE)
    assert one.state == "waiting"
    one.press(Command.QUIT)
    assert one.state == "over"
    assert [take.seed for take in one.takes] == [4, 5, 6, 6, 7]
    assert [bool(KEPT.fullmatch(line) or DISCARDED.fullmatch(line)) for line in one.lines] == [True] * 4
    assert one.recording.counts == {"success": 1, "failure": 1, "partial": 0, "discarded": 2}
    one.recorder.close()
    assert outcomes(tmp_path / "s.h5") == [(4, "success", 3), (6, "failure", 7)]


def test_it_says_where_and_how_many(desk, tmp_path):
    one = desk()
    for count in (1, 2, 3):
        one.begin(n_steps=2)
        one.press(Command.KEEP_SUCCESS)
        assert one.lines[-1].startswith(f"kept demo_{count - 1} success 2 steps contact 0.50 ")
        assert one.lines[-1].endswith(str(tmp_path / "s.h5"))
        assert f"{count} demonstration" in one.recording.message


def test_over_when_so_many_are_kept(desk):
    one = desk(episodes=2)
    one.begin(n_steps=1)
    one.press(Command.KEEP_SUCCESS)
    one.begin(n_steps=1)
    one.press(Command.DISCARD)
    assert one.state == "waiting"
    one.begin(n_steps=1)
    one.press(Command.KEEP_FAILURE)
    assert one.state == "over"


def test_nothing_runs_before_the_countdown_and_the_cloth_are_done(desk):
    one = desk()
    one.takes[0].hangs = False
    one.press(Command.START)
    one.now += COUNTDOWN_S - 0.01
    assert one.move(3) == 0
    assert one.state == "countdown"
    one.now += 1.0
    assert one.move(3) == 0  # The cloth is still being hung.
    one.takes[0].hangs = True
    one.recording.step()
    assert one.state == "running"


def test_time_stands_until_the_first_motion(desk):
    one = desk()
    one.begin()
    one.press()
    assert one.recording.awaits_motion
    assert not any(one.recording.step() for _ in range(5))
    assert one.move(1) == 1
    one.press()  # Standing still in between is part of what is done.
    assert one.recording.step()
    assert [bool(reading.moving) for reading in one.takes[0].readings] == [True, False]


def test_paused_time_stands_and_goes_on(desk):
    one = desk()
    one.begin(n_steps=2)
    one.press(Command.PAUSE)
    assert (one.state, one.move(4)) == ("paused", 0)
    one.press(Command.PAUSE)
    assert one.move(2) == 2
    one.press(Command.PAUSE)
    one.press(Command.START)
    assert one.move(2) == 2
    one.press(Command.PAUSE, Command.KEEP_SUCCESS)
    assert one.recording.counts["success"] == 1


def test_a_pad_that_goes_pauses_and_says_so_and_comes_back(desk):
    one = desk()
    one.begin(n_steps=2)
    gone = TeleopInput(motion=np.zeros(2), connected=False, problem="the pad is gone; plug it in again")
    one.recording.hear(gone)
    assert one.state == "paused"
    said = one.recording.message
    assert said == "paused: the pad is gone; plug it in again"
    assert not one.recording.step()
    one.recording.hear(gone)
    assert one.recording.message == said
    one.recording.hear(TeleopInput(motion=np.zeros(2), device="Pad"))
    assert one.state == "running"
    assert "Pad is back" in one.recording.message
    assert not one.recording.step()  # Nobody has moved yet.
    assert one.move(3) == 3
    assert one.recording.glance.n_steps == 5


def test_what_the_person_paused_stays_paused_when_the_pad_comes_back(desk):
    one = desk()
    one.begin(n_steps=1)
    one.press(Command.PAUSE)
    one.recording.hear(TeleopInput(motion=np.zeros(2), connected=False, problem="gone"))
    one.recording.hear(TeleopInput(motion=np.zeros(2)))
    assert one.state == "paused"


def test_a_pad_that_goes_in_the_countdown_counts_down_again(desk):
    one = desk()
    one.press(Command.START)
    one.recording.hear(TeleopInput(motion=np.zeros(2), connected=False, problem="gone"))
    one.now += 2 * COUNTDOWN_S
    assert one.state == "paused"
    one.recording.hear(TeleopInput(motion=np.zeros(2)))
    assert (one.state, one.recording.countdown_left_s()) == ("countdown", COUNTDOWN_S)


def test_a_cloth_that_came_apart_is_no_success(desk, tmp_path):
    one = desk()
    one.takes[0].unstable_at = 3
    one.begin(n_steps=3)
    assert one.state == "finished"
    one.press(Command.KEEP_SUCCESS)
    assert one.state == "finished"
    one.press(Command.KEEP_FAILURE)
    one.close()
    with open_session(tmp_path / "s.h5") as session:
        assert [(info.outcome, info.stopped_by) for info in session.infos().values()] == [("failure", "unstable")]


def test_the_step_limit_leaves_only_the_verdict(desk, tmp_path):
    one = desk(steps_max=4)
    one.begin()
    assert one.move(9) == 4
    assert one.state == "finished"
    one.press(Command.KEEP_SUCCESS)
    one.close()
    with open_session(tmp_path / "s.h5") as session:
        assert session[0].stopped_by == "step_limit"


def test_quitting_keeps_what_runs_as_partial(desk, tmp_path):
    one = desk()
    one.begin(n_steps=4)
    one.press(Command.QUIT)
    assert one.state == "over"
    assert KEPT.fullmatch(one.lines[-1])
    one.recorder.close()
    assert outcomes(tmp_path / "s.h5") == [(0, "partial", 4)]


def test_a_simulation_that_dies_leaves_what_there_was_and_the_same_seed_again(desk, tmp_path):
    one = desk(seed=9)
    one.takes[0].dies_at = 3
    one.begin(n_steps=5)
    assert one.state == "waiting"
    assert [take.seed for take in one.takes] == [9, 9]
    assert "ended by itself" in one.recording.message
    one.close()
    assert outcomes(tmp_path / "s.h5") == [(9, "partial", 3)]


def test_where_no_cloth_can_be_hung_it_is_said(desk):
    one = desk()

    def dead() -> bool:
        raise EpisodeLost("there is no memory")

    one.takes[0].ready = dead
    with pytest.raises(EpisodeLost, match="no memory"):
        one.recording.step()


def test_disturbing_needs_a_disturbance(desk):
    plain, disturbing = desk(), None
    plain.begin(n_steps=1)
    plain.press(Command.DISTURB)
    assert plain.takes[0].disturbed == []
    plain.close()
    disturbing = desk(disturbance="push")
    disturbing.press(Command.DISTURB)
    disturbing.begin(n_steps=1)
    disturbing.press(Command.DISTURB, Command.DISTURB)
    assert disturbing.takes[0].disturbed == ["push"]


def test_who_records_on_begins_with_the_next_seed(desk, tmp_path):
    path = tmp_path / "s.h5"
    first = desk()
    for verdict in (Command.KEEP_SUCCESS, Command.DISCARD, Command.KEEP_FAILURE):
        first.begin(n_steps=2)
        first.press(verdict)
    first.begin(n_steps=2)
    first.press(Command.QUIT)
    first.close()
    assert recorded_seeds(path, "keyboard") == {0, 2}  # The partial one of seed 3 is to be done again.
    assert recorded_seeds(path, "gamepad") == frozenset()
    assert stored(path) == 3
    second = desk(skip=recorded_seeds(path, "keyboard"))
    assert second.recording.seed == 1
    second.begin(n_steps=2)
    second.press(Command.KEEP_SUCCESS)
    assert second.recording.seed == 3
    assert "4 demonstrations" in second.recording.message


def test_a_session_of_another_robot_is_refused(tmp_path, desk):
    one = desk()
    one.begin(n_steps=2)
    one.press(Command.KEEP_SUCCESS)
    one.close()
    with pytest.raises(ValueError, match="robot hanger, not pickers"):
        SessionRecorder(tmp_path / "s.h5", robot="pickers", cloth="towel")


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.sampled_from([*Command, "move", "wait", "gone"]), max_size=25))
def test_whatever_is_pressed_the_session_holds_what_was_said(tmp_path_factory, acts):
    """Every control that claims to do something does, every other changes nothing; lines and files agree."""
    path = tmp_path_factory.mktemp("any") / "s.h5"
    one = Desk(path, disturbance="push")
    for act in acts:
        if act == "move":
            one.move(2)
        elif act == "wait":
            one.now += COUNTDOWN_S
            one.recording.step()
        elif act == "gone":
            one.recording.hear(TeleopInput(motion=np.zeros(2), connected=False, problem="gone"))
        else:
            before = (one.state, one.recording.seed, len(one.takes), len(one.lines), len(one.takes[-1].disturbed))
            does = one.recording.does(act)
            one.recording.handle(act)
            after = (one.state, one.recording.seed, len(one.takes), len(one.lines), len(one.takes[-1].disturbed))
            assert (before != after) == (does is not None)
    one.close()
    one.close()
    kept = [line.split() for line in one.lines if line.startswith("kept")]
    found = [] if not kept else outcomes(path)
    assert [(outcome, n_steps) for _, outcome, n_steps in found] == [(words[2], int(words[3])) for words in kept]
    assert stored(path) == len(kept)
    assert sum(take.discarded for take in one.takes) + len(kept) == len(one.takes)
