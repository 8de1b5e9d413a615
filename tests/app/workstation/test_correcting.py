"""A model places, and a person takes over: the state machine, the wrong calls, a real terminal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from layflat.app.benchmarks.measure import random_model
from layflat.app.cli import main
from layflat.app.commands.replay import replay
from layflat.app.workstation.teleop.teleop_input import Command, TeleopInput
from layflat.data import open_session
from layflat.policy import model_io as model_files
from layflat.tests.app.workstation.test_by_hand import Terminal
from layflat.tests.app.workstation.test_recording import Desk


@pytest.fixture
def desk(tmp_path) -> Desk:
    made = Desk(tmp_path / "s.h5", led=True)
    yield made
    made.close()


def _rest(desk: Desk, n_steps: int) -> int:
    desk.recording.hear(TeleopInput(motion=np.zeros(2)))
    return sum(desk.recording.step() for _ in range(n_steps))


def test_time_waits_for_nobody_while_a_policy_leads(desk):
    desk.press(Command.START)
    desk.now += 10.0
    desk.recording.step()
    assert desk.state == "running"
    assert not desk.recording.awaits_motion
    assert _rest(desk, 5) == 5
    desk.press(Command.PAUSE)
    assert _rest(desk, 5) == 0
    desk.press(Command.PAUSE)
    assert _rest(desk, 2) == 2


def test_after_its_stop_time_stands_until_the_hands_move(desk):
    desk.press(Command.START)
    desk.now += 10.0
    desk.recording.step()
    take = desk.takes[0]
    real, stops = take.step, iter([None, "threshold", None, None])
    take.step = lambda *given: replace(real(*given), stopped_by=next(stops))
    assert _rest(desk, 6) == 2
    assert desk.recording.awaits_motion
    assert "has stopped (threshold)" in desk.recording.message
    assert desk.recording.does(Command.KEEP_SUCCESS)
    assert desk.move(1) == 1
    assert "you have the lead" in desk.recording.message
    assert _rest(desk, 1) == 1


def test_who_leads_is_said_and_a_button_hands_back(desk):
    desk.press(Command.START)
    desk.now += 10.0
    desk.recording.step()
    desk.takes[0].corrects = True
    assert _rest(desk, 2) == 2
    assert desk.recording.does(Command.START) is None
    assert desk.move(1) == 1
    assert desk.recording.message == "you have the lead; rest, and the policy has it again"
    assert desk.recording.does(Command.START) == "hand back to the policy"
    desk.press(Command.START)
    assert desk.state == "running"
    assert _rest(desk, 1) == 1
    assert not desk.recording.glance.led
    assert desk.recording.message == "the policy has the lead again"


def test_a_pad_unplugged_in_a_correction_pauses_and_goes_on(desk):
    desk.press(Command.START)
    desk.now += 10.0
    desk.recording.step()
    assert desk.move(2) == 2
    desk.recording.hear(TeleopInput(motion=np.zeros(2), connected=False, problem="the pad is gone"))
    assert (desk.state, desk.recording.message) == ("paused", "paused: the pad is gone")
    assert not desk.recording.step()
    assert _rest(desk, 2) == 2
    assert "is back; the policy places; move to take over" in desk.recording.message


WRONG: list[tuple[tuple[str, ...], str]] = [
    (("--source", "scripted", "--correct", "m.npz"), "--correct needs a person"),
    (("--source", "keyboard", "--correct", "missing.npz"), "missing.npz"),
    (("--source", "keyboard", "--correct", "m.npz", "--robot", "hanger"), "give --robot pickers"),
    (("--source", "keyboard", "--correct", "m.npz", "--robot", "pickers", "--descriptor", "how"), "give --descriptor"),
]


@pytest.mark.parametrize(("call", "sentence"), WRONG)
def test_what_cannot_be_corrected_is_one_sentence(call, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    model_files.save(random_model("pickers", 20), tmp_path / "m.npz")
    with pytest.raises(SystemExit) as stop:
        main.main(["record", "s.h5", *call])
    assert stop.value.code == 2
    assert sentence in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["m.npz"]


@pytest.fixture
def terminal() -> Callable[..., Terminal]:
    made: list[Terminal] = []

    def start(*arguments: object) -> Terminal:
        made.append(Terminal(*arguments))
        return made[-1]

    yield start
    for each in made:
        each.close()


@pytest.mark.slow
def test_a_correction_at_the_keyboard_is_marked_and_runs_again(terminal, tmp_path):
    """The model knows no move: it stops after eight steps, and again so long after each correction."""
    path, model = tmp_path / "s.h5", random_model("pickers", 20)
    model_files.save(replace(model, alpha=np.zeros_like(model.alpha)), tmp_path / "m.npz")
    one = terminal(
        "record", path, "--source", "keyboard", "--robot", "pickers", "--cloth", "napkin", "--correct",
        tmp_path / "m.npz", "--no-window",
    )  # fmt: skip
    one.until(" hangs]")
    one.type("\r")
    one.until("has stopped (threshold)")
    one.hold("s", 0.6)
    one.until("you have the lead")
    one.until("has stopped (threshold)")
    one.type("y")
    one.until("kept demo_0 success ")
    assert one.end() == 0
    with open_session(path) as session:
        (info,) = session.infos().values()
        episode = session[0]
    assert info.source == "gp-word+keyboard"
    marked = [step.intervention for step in episode.steps]
    first, last = marked.index(True), len(marked) - marked[::-1].index(True)
    assert 0 < first < last < len(marked)
    assert all(marked[first:last])
    assert any(step.action.any() for step in episode.steps[first:last])
    assert not any(step.action.any() for step in (*episode.steps[:first], *episode.steps[last:]))
    replay(path, episode=0, mode="action", json=tmp_path / "r.json", force=False)
    assert '"identical": true' in (tmp_path / "r.json").read_text()
