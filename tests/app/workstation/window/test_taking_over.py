"""A person takes over from a policy in the window: a virtual gamepad, keys, and what is on disk."""

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
from layflat.app.workstation.session.activities import make_activity
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
from layflat.tests.app.workstation.window.test_endings import BASE, ROOT, display  # noqa: F401  # A fixture.
from layflat.tests.app.workstation.window.test_window import leftovers

pytestmark = pytest.mark.timeout(300)

WRAPPER_LIST = 4
"""Number of the list of wrappers on the Place page of a policy without a model."""


@pytest.fixture
def window(tmp_path: Path) -> Iterator[Callable[..., Window]]:
    headless()
    made: list[Window] = []

    def make(work=make_fake, **settings: object) -> Window:
        made.append(Window(tmp_path, work))
        made[-1].context.change_settings(replace(made[-1].context.settings, **settings))
        return made[-1]

    yield make
    unplug_all()
    for each in made:
        each.close()
    assert leftovers() == []


def begin(person: Person, source: str, record: str = "") -> PlacePage:
    """Place with a person at a device."""
    person.tab("Place")
    page = person.window.page
    assert isinstance(page, PlacePage)
    page.source, page.record = source, record
    page.build()
    person.menu("Place")
    person.wait(lambda: person.state() == "placing" and person.status["steps"] >= 3, "it to begin")
    return page


def controller(person: Person) -> str:
    return str(person.status.get("controller"))


def colors(window: Window, area: pygame.Rect) -> set[tuple[int, ...]]:
    """Return the colors that are drawn there."""
    window.redraw()
    seen = pygame.surfarray.array3d(window.surface.subsurface(area)).reshape(-1, 3)
    return {tuple(int(v) for v in color) for color in np.unique(seen, axis=0)}


def the_episode(path: Path) -> Episode:
    assert validate(path) == ()
    with open_session(path) as session:
        (name,) = session.names
        return session.episode(name)


@pytest.mark.parametrize(("choice", "who"), [("none", "forward"), ("both", "forward+recovery+steady")])
def test_wrappers_are_chosen_in_the_menu(window, choice, who):
    one = window()
    person = Person(one)
    person.tab("Place")
    person.choose(WRAPPER_LIST, choice)
    person.menu("Place")
    person.wait(lambda: person.state() == "placing" and person.status["steps"] >= 3, "it to begin")
    assert person.status["policy"] == who


def test_a_gamepad_takes_over_and_the_window_shows_who_is_in_control(window):
    one = window()
    person, place = Person(one), one.context.layout
    pad = person.plug_in()
    begin(person, "gamepad", "placed")
    assert controller(person) == "forward"
    assert style.HUMAN not in colors(one, place.status) | colors(one, place.contact)
    pad.axis("left_x", -1.0)
    person.wait(lambda: controller(person) == "you", "control", 5.0)
    person.look()
    assert one.page.headline() == ("You are in control", style.HUMAN)
    assert one.context.message == "you are in control; stop moving to return control to forward"
    assert style.HUMAN in colors(one, place.status)
    person.wait(lambda: person.seen().human_in_control, "the curve")
    person.watch(0.3)
    assert style.HUMAN in colors(one, place.contact)
    assert style.HUMAN in colors(one, place.word)
    pad.axis("left_x", 0.0)
    person.wait(lambda: controller(person) == "forward", "its return", 5.0)
    # Again, and back by the button.
    pad.axis("left_y", 1.0)
    person.wait(lambda: controller(person) == "you", "control", 5.0)
    pad.axis("left_y", 0.0)
    person.look()
    assert ("Cross", "return control to forward") in [hint[:2] for hint in one.page.key_hints()]
    person.press("return control to forward")
    person.wait(lambda: controller(person) == "forward", "its return", 5.0)
    pad.tap("triangle")
    person.wait(lambda: one.page.finished, "it to be kept")
    assert one.context.message.startswith("kept demo_0 success ")
    one.page.stop()
    episode = the_episode(one.context.folder / "placed.h5")
    assert episode.source == "forward+gamepad"
    marked = [step.intervention for step in episode.steps]
    runs = np.flatnonzero(np.diff([False, *marked, False])).reshape(-1, 2)
    assert len(runs) == 2
    first, second = (episode.steps[start].action for start, _ in runs)
    assert first[0] < 0 == first[1]
    assert second[1] < 0 == second[0]
    # A replay shows the same.
    person.tab("Replay")
    page = one.page
    assert isinstance(page, ReplayPage)
    page.session = "placed.h5"
    page.build()
    person.menu("Watch")
    page.show(int(runs[0][0]))
    assert page.series()[0].human == [False, *marked]
    assert "a person is in control" in [row.value for row in page.rows()]
    assert style.HUMAN in colors(one, place.contact)


def test_a_disconnect_in_a_correction_is_shown(window):
    one = window()
    person = Person(one)
    pad = person.plug_in()
    begin(person, "gamepad")
    pad.axis("left_x", -1.0)
    person.wait(lambda: controller(person) == "you", "control", 5.0)
    pad.unplug()
    person.wait(lambda: person.status["paused"], "the pause", 5.0)
    person.look()
    assert one.page.banner() == ("Paused", one.context.message)
    assert "was disconnected; plug it in again" in one.context.message
    at = person.status["steps"]
    person.watch(0.4)
    assert person.status["steps"] == at
    person.plug_in()
    person.wait(lambda: not person.status["paused"], "it to go on", 5.0)
    person.look()
    assert "is connected again" in one.context.message
    person.wait(lambda: controller(person) == "forward", "its return", 5.0)


def test_keys_that_take_over_are_no_shortcuts(window):
    one = window()
    person = Person(one)
    page = begin(person, "keyboard")
    seed = page.seed
    post(pygame.KEYDOWN, key=pygame.K_DOWN, mod=0, unicode="")
    person.wait(lambda: controller(person) == "you", "control", 5.0)
    post(pygame.KEYUP, key=pygame.K_DOWN, mod=0)
    person.wait(lambda: controller(person) == "forward", "its return", 5.0)
    # n keeps as failure, which is refused where nothing is recorded; 1 is a speed.
    person.key(pygame.K_n, "n")
    person.key(pygame.K_1, "1")
    person.wait(lambda: "nothing is recorded" in one.context.message, "the sentence", 5.0)
    assert (page.seed, person.status["disturbances"]) == (seed, [])
    assert {hint.key for hint in page.key_hints() if hint.text in ("next seed", "push")} == {"•"}
    person.key(pygame.K_SPACE, " ")
    person.wait(lambda: person.status["paused"], "the pause", 5.0)
    person.key(pygame.K_ESCAPE)
    assert not page.running
    assert one.input_manager.describe() == ""


def test_a_hand_that_grabs_the_hanger_takes_over(window):
    one = window()
    person = Person(one)
    page = begin(person, "kinesthetic", "led")
    assert not page.accepts_drag(), "the mouse is the hand, and does not drag the cloth"
    person.key(pygame.K_SPACE, " ")
    person.wait(lambda: person.status["paused"], "the pause", 5.0)
    view, corner = one.context.layout.view, person.seen().corners[0]
    x, y = one.viewport.pixel_of(corner, view.size)
    post(pygame.MOUSEBUTTONDOWN, pos=(x + view.left, y + view.top), button=1)
    person.key(pygame.K_SPACE, " ")
    person.wait(lambda: controller(person) == "you", "control", 5.0)
    post(pygame.MOUSEBUTTONUP, pos=(x + view.left, y + view.top), button=1)
    person.wait(lambda: controller(person) == "forward", "its return", 5.0)
    person.press("keep as failure")
    person.wait(lambda: page.finished, "it to be kept")
    page.stop()
    episode = the_episode(one.context.folder / "led.h5")
    assert (episode.source, episode.outcome) == ("forward+kinesthetic", "failure")
    held = [step.hand_m is not None for step in episode.steps]
    assert any(held)
    assert all(step.intervention for step, hand in zip(episode.steps, held, strict=True) if hand)


def test_without_a_gamepad_the_policy_can_continue_alone(window):
    one = window()
    person = Person(one)
    person.tab("Place")
    one.page.source = "gamepad"
    one.page.build()
    person.menu("Place")
    person.wait(lambda: bool(person.status.get("paused")), "the pause")
    person.look()
    assert "no gamepad is plugged in" in one.context.message
    person.key(pygame.K_SPACE, " ")
    person.wait(lambda: person.status["steps"] > 5, "it to go on")
    assert controller(person) == "forward"


def still_model(folder: Path) -> Path:
    """Write a model that never moves: it stops after eight steps."""
    model = random_model("pickers", 20)
    model_files.save(replace(model, alpha=np.zeros_like(model.alpha)), folder / "m.npz")
    return folder / "m.npz"


def layflat(*arguments: object) -> None:
    with pytest.raises(SystemExit) as stop:
        main.main([str(one) for one in arguments])
    assert stop.value.code == 0


@pytest.mark.slow
def test_a_correction_in_the_window_can_be_trained_on(window, tmp_path, capsys):
    still_model(tmp_path)
    one = window(make_activity, model="m.npz", speed="real time")
    person = Person(one)
    pad = person.plug_in()
    begin(person, "gamepad", "corrected")
    person.wait(lambda: person.state() == "placed", "its stop")
    assert "move to continue yourself" in person.status["message"]
    for name in ("left_y", "right_y"):
        pad.axis(name, 1.0)
    person.wait(lambda: person.status["intervention_steps"] >= 20, "a correction")
    pad.unplug()
    person.wait(lambda: person.status["paused"], "the pause")
    pad = person.plug_in()
    person.wait(lambda: controller(person) == "gp-word", "its return")
    pad.tap("triangle")
    person.wait(lambda: one.page.finished, "it to be kept")
    one.page.stop()
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
    command = [sys.executable, "-m", "layflat.tests.app.workstation.person_process", str(tmp_path), "once", "--correct"]
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
