"""A person at the window takes over from what places: a pad that SDL takes for real, keys, and what is on disk."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pygame
import pytest

from layflat.app.benchmarks.measure import random_model
from layflat.app.cli import main
from layflat.app.workstation.session.tasks import make_task
from layflat.app.workstation.window import style
from layflat.app.workstation.window.pages.place import PlacePage
from layflat.app.workstation.window.pages.replay import ReplayPage
from layflat.app.workstation.window.window import Window
from layflat.data import validate
from layflat.data.session.reader import open_session
from layflat.data.types import Episode
from layflat.policy import model_io as model_files
from layflat.policy.wrappers.takeover import REST_STEPS
from layflat.tests.app.workstation.fake_placing import make_fake
from layflat.tests.app.workstation.person import Person, headless, post, unplug_all
from layflat.tests.app.workstation.test_ends import BASE, ROOT, display  # noqa: F401  # A fixture.
from layflat.tests.app.workstation.test_workstation import leftovers

pytestmark = pytest.mark.timeout(300)

HELP_LIST = 4
"""Of the lists in the Place tab without a model: who decides, robot, cloth, who may take over, what helps it."""


@pytest.fixture
def window(tmp_path: Path) -> Iterator[Callable[..., Window]]:
    headless()
    made: list[Window] = []

    def make(work=make_fake, **settings: object) -> Window:
        made.append(Window(tmp_path, work))
        made[-1].shop.change(replace(made[-1].shop.settings, **settings))
        return made[-1]

    yield make
    unplug_all()
    for each in made:
        each.close()
    assert leftovers() == []


def begin(person: Person, source: str, record: str = "") -> PlacePage:
    """Place with somebody at a device."""
    person.tab("Place")
    mode = person.window.mode
    assert isinstance(mode, PlacePage)
    mode.source, mode.record = source, record
    mode.build()
    person.menu("Place")
    person.wait(lambda: person.state() == "placing" and person.status["steps"] >= 3, "it to begin")
    return mode


def leads(person: Person) -> str:
    return str(person.status.get("leads"))


def colours(window: Window, area: pygame.Rect) -> set[tuple[int, ...]]:
    """What is seen there."""
    window._painted.clear()
    window.draw()
    seen = pygame.surfarray.array3d(window.surface.subsurface(area)).reshape(-1, 3)
    return {tuple(int(v) for v in colour) for colour in np.unique(seen, axis=0)}


def the_episode(path: Path) -> Episode:
    assert validate(path) == ()
    with open_session(path) as session:
        (name,) = session.names
        return session.episode(name)


@pytest.mark.parametrize(("choice", "who"), [("nothing", "forward"), ("both", "forward+recovery+steady")])
def test_what_is_around_the_policy_is_chosen_in_the_menu(window, choice, who):
    one = window()
    person = Person(one)
    person.tab("Place")
    person.choose(HELP_LIST, choice)
    person.menu("Place")
    person.wait(lambda: person.state() == "placing" and person.status["steps"] >= 3, "it to begin")
    assert person.status["policy"] == who


def test_a_pad_takes_over_and_the_window_says_who_leads(window):
    one = window()
    person, place = Person(one), one.shop.place
    pad = person.plug_in()
    begin(person, "gamepad", "placed")
    assert leads(person) == "forward"
    assert style.LED not in colours(one, place.status) | colours(one, place.contact)
    pad.axis("left_x", -1.0)
    person.wait(lambda: leads(person) == "you", "the lead", 5.0)
    person.look()
    assert one.mode.headline() == ("You lead", style.LED)
    assert one.shop.message == "you have the lead; rest, and forward has it again"
    assert style.LED in colours(one, place.status)
    person.wait(lambda: person.moment().led, "the curve")
    person.watch(0.3)
    assert style.LED in colours(one, place.contact)
    assert style.LED in colours(one, place.word)
    pad.axis("left_x", 0.0)
    person.wait(lambda: leads(person) == "forward", "it to be handed back", 5.0)
    # Again, and back by the button that says so.
    pad.axis("left_y", 1.0)
    person.wait(lambda: leads(person) == "you", "the lead", 5.0)
    pad.axis("left_y", 0.0)
    person.look()
    assert ("Cross", "hand back to forward") in [chip[:2] for chip in one.mode.chips()]
    person.press("hand back to forward")
    person.wait(lambda: leads(person) == "forward", "it to be handed back", 5.0)
    pad.tap("triangle")
    person.wait(lambda: one.mode.finished, "it to be kept")
    assert one.shop.message.startswith("kept demo_0 success ")
    one.mode.stop()
    episode = the_episode(one.shop.folder / "placed.h5")
    assert episode.source == "forward+gamepad"
    marked = [step.intervention for step in episode.steps]
    runs = np.flatnonzero(np.diff([False, *marked, False])).reshape(-1, 2)
    assert len(runs) == 2
    first, second = (episode.steps[start].action for start, _ in runs)
    assert first[0] < 0 == first[1]
    assert second[1] < 0 == second[0]
    # A replay says the same.
    person.tab("Replay")
    mode = one.mode
    assert isinstance(mode, ReplayPage)
    mode.session = "placed.h5"
    mode.build()
    person.menu("Watch")
    mode.to(int(runs[0][0]))
    assert mode.history()[0].led == [False, *marked]
    assert "a person leads" in [row.value for row in mode.rows()]
    assert style.LED in colours(one, place.contact)


def test_a_pad_unplugged_in_the_middle_of_a_correction_is_said(window):
    one = window()
    person = Person(one)
    pad = person.plug_in()
    begin(person, "gamepad")
    pad.axis("left_x", -1.0)
    person.wait(lambda: leads(person) == "you", "the lead", 5.0)
    pad.unplug()
    person.wait(lambda: person.status["paused"], "the pause", 5.0)
    person.look()
    assert one.mode.banner() == ("Paused", one.shop.message)
    assert "is gone; plug it in again" in one.shop.message
    at = person.status["steps"]
    person.watch(0.4)
    assert person.status["steps"] == at
    person.plug_in()
    person.wait(lambda: not person.status["paused"], "it to go on", 5.0)
    person.look()
    assert "is back" in one.shop.message
    person.wait(lambda: leads(person) == "forward", "it to be handed back", 5.0)


def test_keys_take_over_and_are_no_shortcuts_meanwhile(window):
    one = window()
    person = Person(one)
    mode = begin(person, "keyboard")
    seed = mode.seed
    post(pygame.KEYDOWN, key=pygame.K_DOWN, mod=0, unicode="")
    person.wait(lambda: leads(person) == "you", "the lead", 5.0)
    post(pygame.KEYUP, key=pygame.K_DOWN, mod=0)
    person.wait(lambda: leads(person) == "forward", "it to be handed back", 5.0)
    # n keeps as a failure, which cannot be where nothing is recorded; 1 is a speed.
    person.key(pygame.K_n, "n")
    person.key(pygame.K_1, "1")
    person.wait(lambda: "nothing is recorded" in one.shop.message, "the sentence", 5.0)
    assert (mode.seed, person.status["disturbances"]) == (seed, [])
    assert {chip.key for chip in mode.chips() if chip.does in ("next seed", "push")} == {"•"}
    person.key(pygame.K_SPACE, " ")
    person.wait(lambda: person.status["paused"], "the pause", 5.0)
    person.key(pygame.K_ESCAPE)
    assert not mode.running
    assert one.hands.told() == ""


def test_a_hand_that_takes_hold_of_the_hanger_leads_it(window):
    one = window()
    person = Person(one)
    mode = begin(person, "kinesthetic", "led")
    assert not mode.pullable(), "the mouse is the hand, and pulls at nothing else"
    person.key(pygame.K_SPACE, " ")
    person.wait(lambda: person.status["paused"], "the pause", 5.0)
    view, corner = one.shop.place.view, person.moment().corners[0]
    x, y = one.pane.pixel_of(corner, view.size)
    post(pygame.MOUSEBUTTONDOWN, pos=(x + view.left, y + view.top), button=1)
    person.key(pygame.K_SPACE, " ")
    person.wait(lambda: leads(person) == "you", "the lead", 5.0)
    post(pygame.MOUSEBUTTONUP, pos=(x + view.left, y + view.top), button=1)
    person.wait(lambda: leads(person) == "forward", "it to be handed back", 5.0)
    person.press("keep as failure")
    person.wait(lambda: mode.finished, "it to be kept")
    mode.stop()
    episode = the_episode(one.shop.folder / "led.h5")
    assert (episode.source, episode.outcome) == ("forward+kinesthetic", "failure")
    held = [step.hand_m is not None for step in episode.steps]
    assert any(held)
    assert all(step.intervention for step, hand in zip(episode.steps, held, strict=True) if hand)


def test_no_pad_is_said_and_the_policy_can_go_on_alone(window):
    one = window()
    person = Person(one)
    person.tab("Place")
    one.mode.source = "gamepad"
    one.mode.build()
    person.menu("Place")
    person.wait(lambda: bool(person.status.get("paused")), "the pause")
    person.look()
    assert "no gamepad is plugged in" in one.shop.message
    person.key(pygame.K_SPACE, " ")
    person.wait(lambda: person.status["steps"] > 5, "it to go on")
    assert leads(person) == "forward"


def still_model(folder: Path) -> Path:
    """A model that knows no move: it stops after eight steps."""
    model = random_model("pickers", 20)
    model_files.save(replace(model, alpha=np.zeros_like(model.alpha)), folder / "m.npz")
    return folder / "m.npz"


def layflat(*arguments: object) -> None:
    with pytest.raises(SystemExit) as stop:
        main.main([str(one) for one in arguments])
    assert stop.value.code == 0


@pytest.mark.slow
def test_a_correction_at_the_window_is_learned_from(window, tmp_path, capsys):
    still_model(tmp_path)
    one = window(make_task, model="m.npz", speed="real time")
    person = Person(one)
    pad = person.plug_in()
    begin(person, "gamepad", "corrected")
    person.wait(lambda: person.state() == "placed", "its stop")
    assert "move to go on yourself" in person.status["message"]
    for name in ("left_y", "right_y"):
        pad.axis(name, 1.0)
    person.wait(lambda: person.status["led_steps"] >= 20, "a correction")
    pad.unplug()
    person.wait(lambda: person.status["paused"], "the pause")
    pad = person.plug_in()
    person.wait(lambda: leads(person) == "gp-word", "it to be handed back")
    pad.tap("triangle")
    person.wait(lambda: one.mode.finished, "it to be kept")
    one.mode.stop()
    path = tmp_path / "corrected.h5"
    episode = the_episode(path)
    assert (episode.source, episode.outcome) == ("gp-word+gamepad", "success")
    marked = np.array([step.intervention for step in episode.steps])
    actions = np.array([step.action for step in episode.steps])
    assert 20 <= marked.sum() <= 20 + 4 + REST_STEPS
    assert (actions[marked][:20, [2, 5]] < 0).all(), "both went down"
    assert not actions[~marked].any(), "the model stood still"
    layflat("train", path, tmp_path / "better.npz", "--intervention-weight", "3")
    assert f"{marked.sum()} steps in which a person corrected a policy count 3 times each" in capsys.readouterr().out
    layflat("replay", path, "--episode", "0", "--mode", "action", "--json", tmp_path / "r.json")
    assert '"identical": true' in (tmp_path / "r.json").read_text()


@pytest.mark.slow
def test_record_corrects_a_model_in_its_window(tmp_path, display):  # noqa: F811
    """`layflat record --source keyboard --correct MODEL.npz` on an X server: the window, one line, one file."""
    environment = {key: value for key, value in BASE.items() if key not in ("SDL_VIDEODRIVER", "WAYLAND_DISPLAY")}
    command = [sys.executable, "-m", "layflat.tests.app.workstation.sitting", str(tmp_path), "once", "--correct"]
    done = subprocess.run(
        [*command, str(still_model(tmp_path))],
        cwd=ROOT, env={**environment, "DISPLAY": display}, capture_output=True, text=True, timeout=240,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    (line,) = [line for line in done.stdout.splitlines() if line.startswith(("kept", "discarded"))]
    assert line.startswith("kept demo_0 success ")
    episode = the_episode(tmp_path / "one.h5")
    assert episode.source == "gp-word+keyboard"
    marked = [step.intervention for step in episode.steps]
    assert any(marked)
    assert min(step.action[2] for step, mine in zip(episode.steps, marked, strict=True) if mine) < 0
