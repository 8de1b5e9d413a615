"""A person uses the window from beginning to end: a pad that SDL takes for real, the mouse, and what is on disk."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pygame
import pytest
from pygame_menu.widgets import ToggleSwitch

from layflat.app.workstation.session.tasks import make_task
from layflat.app.workstation.window.layout import LEAST
from layflat.app.workstation.window.pages.data import OPERATIONS, DataPage
from layflat.app.workstation.window.pages.place import PlacePage
from layflat.app.workstation.window.pages.record import RecordPage
from layflat.app.workstation.window.pages.replay import ReplayPage
from layflat.app.workstation.window.pages.train import TrainPage
from layflat.app.workstation.window.window import Window
from layflat.data.session.reader import open_session
from layflat.data.session.recorder import SessionRecorder
from layflat.data.tools.validate import validate
from layflat.data.types import ACTION_LIMIT_M, Episode
from layflat.sim.robots.registry import robot_spec
from layflat.tests.app.workstation.person import Person, headless, unplug_all

pytestmark = pytest.mark.timeout(400)


@pytest.fixture
def window(tmp_path: Path) -> Iterator[Window]:
    headless()
    made = Window(tmp_path, make_task)
    made.shop.change(replace(made.shop.settings, speed="as fast as it goes", countdown_s=0.3))
    made.mode.relaid()
    yield made
    # A pad that outlives its SDL is a crash.
    unplug_all()
    made.close()
    assert leftovers() == []


def leftovers() -> list[str]:
    """Processes of ours that are still there, but for Python's own fork server and tracker."""
    found = []
    for process in psutil.Process().children(recursive=True):
        try:
            line = " ".join(process.cmdline())
        except psutil.Error:
            continue
        # The fork server's children carry its command line; itself, it is this process's own child.
        server = "multiprocessing" in line and process.ppid() == os.getpid()
        if not server and process.status() != psutil.STATUS_ZOMBIE:
            found.append(line)
    return found


def set_up(window: Window, robot: str) -> None:
    window.shop.change(replace(window.shop.settings, robot=robot, session=f"{robot}.h5"))
    window.mode.relaid()


def stored_episodes(path: Path) -> list[Episode]:
    assert not validate(path)
    with open_session(path) as session:
        return [session.episode(name) for name in session.names]


def record_three(person: Person, n_steps: int | None) -> list[int]:
    """One kept as success, one discarded, one with the pad unplugged in its middle; returns steps of those kept."""
    pad, lengths = person.plug_in(), []
    person.menu("Begin")

    def keep() -> None:
        before = person.status["stored"]
        lengths.append(int(person.status["steps"]))
        person.pad.tap("triangle")
        person.wait(lambda: person.status.get("stored") == before + 1, "it to be kept")
        assert "kept demo_" in person.window.shop.message

    person.begin()
    person.demonstrate(0, n_steps=n_steps)
    keep()
    person.begin()
    person.demonstrate(1, n_steps=8)
    pad.tap("circle")
    person.wait(lambda: person.status["counts"]["discarded"] == 1, "it to be discarded")
    person.begin()
    person.demonstrate(2, n_steps=8)
    pad.unplug()
    person.wait(lambda: person.state() == "paused", "the pause")
    assert "is gone" in person.window.hands.told()
    at = person.status["steps"]
    person.watch(0.5)
    assert person.status["steps"] == at, "time stands without a device"
    person.plug_in()
    person.wait(lambda: person.state() == "running", "it to go on")
    person.demonstrate(2, n_steps=n_steps)
    keep()
    person.pad.tap("ps")
    person.wait(lambda: not person.window.mode.running, "the end of the recording")
    return lengths


def check_recorded(path: Path, robot: str, lengths: list[int]) -> None:
    """The file holds exactly what was kept."""
    episodes = stored_episodes(path)
    assert [(e.outcome, e.source, e.robot, e.seed) for e in episodes] == [
        ("success", "gamepad", robot, 0),
        ("success", "gamepad", robot, 2),
    ]
    # Between the last look and the button a step or two went by.
    assert all(length <= len(e.steps) <= length + 4 for e, length in zip(episodes, lengths, strict=True))
    for episode in episodes:
        actions = np.array([step.action for step in episode.steps])
        assert actions.shape[1] == robot_spec(robot).size
        assert 0 < np.abs(actions).max() <= ACTION_LIMIT_M
        times = [seen.time_s for seen in episode.observations()]
        np.testing.assert_allclose(np.diff(times), episode.step_s, atol=1e-9)
        assert not any(step.drag for step in episode.steps)


def train(person: Person, session: str) -> str:
    person.tab("Train")
    mode = person.window.mode
    assert isinstance(mode, TrainPage)
    mode.session, mode.model = session, "learned.npz"
    mode.replace_model = True
    mode.build()
    person.menu("Train")
    person.wait(lambda: mode.job is not None and mode.job.status is not None, "training", 300.0)
    assert mode.job.status == 0, list(mode.job.lines)
    person.look()
    return mode.model


def place_and_pull(person: Person, n_steps: int | None) -> int | None:
    """Place with what was learned into a session of its own, and pull at the cloth with the mouse meanwhile.

    Returns the node that was seen under the mouse.
    """
    person.tab("Place")
    mode = person.window.mode
    assert isinstance(mode, PlacePage)
    assert person.window.shop.settings.model == "learned.npz"
    mode.seed, mode.record = 9, "placed"
    mode.build()
    person.menu("Place")
    person.wait(lambda: person.state() == "placing" and person.status["steps"] >= 3, "it to begin")
    if n_steps is None:
        person.wait(lambda: person.state() == "placed", "it to be placed", 90.0)
    moment = person.moment()
    pulled = person.drag_node(45, (-50, -40), frames=10, until=lambda: person.status["pulled_steps"] >= 4)
    if n_steps is None:
        person.wait(lambda: person.state() == "repairing", "the repair")
        person.wait(lambda: person.state() == "placed", "the repair's end", 60.0)
    person.key(pygame.K_2)
    person.wait(lambda: person.status["disturbances"] == ["pull"], "the disturbance")
    person.wait(lambda at=person.status["steps"]: person.status["steps"] > at + 3, "it to act")
    person.press("keep")
    person.wait(lambda: mode.finished, "it to be kept")
    mode.stop()
    assert moment is not None
    assert pulled is not None
    # A fold may hide the node that is aimed at; what is taken instead is seen there.
    aimed, taken = (person.window.pane.orbit.project(moment.nodes[[k]], (700, 600))[0][0] for k in (45, pulled))
    assert np.linalg.norm(aimed - taken) < 30
    return pulled


def check_placed(path: Path, node: int | None) -> None:
    (episode,) = stored_episodes(path)
    assert (episode.source, episode.seed) == ("gp-word", 9)
    pulled = [step for step in episode.steps if step.drag is not None]
    assert pulled, "the mouse's pull is in the file"
    assert {step.drag.node for step in pulled} == {node}
    assert max(float(np.linalg.norm(step.force_n)) for step in pulled) > 0.01
    assert [record.name for record in episode.disturbances] == ["pull"]


def replay(person: Person, session: str) -> None:
    person.tab("Replay")
    mode = person.window.mode
    assert isinstance(mode, ReplayPage)
    mode.session = session
    mode.build()
    person.menu("Watch")
    assert mode.playback is not None
    last = mode.playback.last
    person.wait(lambda: mode.at > 0, "it to play")
    bar = mode.bar()
    person.click((bar.left + 16 + (bar.width - 32) // 2, bar.centery))
    assert mode.at == pytest.approx(last / 2, abs=1)
    np.testing.assert_array_equal(mode.moment().nodes, mode.playback.episode.ground_truths()[mode.at].nodes)
    person.key(pygame.K_END)
    assert mode.at == last


def use_it_all(window: Window, robot: str, n_steps: int | None) -> None:
    person = Person(window)
    set_up(window, robot)
    folder = window.shop.folder
    lengths = record_three(person, n_steps)
    check_recorded(folder / f"{robot}.h5", robot, lengths)
    train(person, f"{robot}.h5")
    node = place_and_pull(person, n_steps)
    assert node == 45 or robot == "pickers"
    check_placed(folder / "placed.h5", node)
    replay(person, "placed.h5")
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    person.look()
    assert not window.open
    window.close()
    names = {path.name for path in folder.iterdir() if not path.name.endswith(".parts")}
    assert names == {f"{robot}.h5", "learned.npz", "placed.h5", "workstation.json"}
    assert not [path for path in folder.rglob("*") if path.suffix in (".journal", ".part")]


def test_a_short_afternoon_at_the_workstation(window):
    use_it_all(window, "hanger", n_steps=14)


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("robot", ["hanger", "pickers"])
def test_an_afternoon_at_the_workstation(window, robot):
    use_it_all(window, robot, n_steps=None)
    episodes = stored_episodes(window.shop.folder / f"{robot}.h5")
    # The person laid it: the demonstrations are what their verdict says.
    assert all(episode.final_ground_truth.flat_area > 0.9 for episode in episodes)


def test_a_simulation_that_dies_costs_one_demonstration_and_not_the_window(window):
    person = Person(window)
    set_up(window, "pickers")
    person.plug_in()
    person.menu("Begin")
    person.begin()
    person.demonstrate(0, n_steps=10)
    (take,) = psutil.Process(window.shop.link.pid).children()
    take.kill()
    person.pad.axis("left_y", 0.5)
    person.wait(lambda: person.status["counts"]["partial"] == 1, "the news")
    assert "ended by itself" in person.status["message"]
    # The same start again, and the device is still in the hands.
    person.pad.axis("left_y", 0.0)
    person.begin()
    person.demonstrate(0, n_steps=6)
    person.pad.tap("triangle")
    person.wait(lambda: person.status["stored"] == 2, "it to be kept")
    person.key(pygame.K_ESCAPE)
    assert not window.mode.running
    partial, whole = stored_episodes(window.shop.folder / "pickers.h5")
    assert (partial.outcome, partial.stopped_by, whole.outcome) == ("partial", "crashed", "success")
    assert len(partial.steps) >= 8


def test_a_bench_that_dies_is_a_sentence_and_the_menu_is_back(window):
    person = Person(window)
    set_up(window, "pickers")
    person.plug_in()
    person.menu("Begin")
    person.begin()
    person.demonstrate(0, n_steps=10)
    bench = psutil.Process(window.shop.link.pid)
    family = [bench, *bench.children(recursive=True)]
    bench.kill()
    person.wait(lambda: isinstance(window.mode, RecordPage) and not window.mode.running, "the menu")
    assert "ended by itself (signal 9)" in window.shop.message
    psutil.wait_procs(family, timeout=40)
    assert leftovers() == []
    # What there was of it is back with the next recording.
    person.menu("Begin")
    person.wait(lambda: person.status.get("stored") == 1, "the recovered steps")
    window.mode.stop()
    (partial,) = stored_episodes(window.shop.folder / "pickers.h5")
    assert partial.outcome == "partial"


def test_the_hanger_is_led_by_hand(window):
    """Kinesthetic teaching: the mouse takes hold of the hanger, which gives way; what it did is the action."""
    person = Person(window)
    set_up(window, "hanger")
    window.shop.change(replace(window.shop.settings, source="kinesthetic"))
    window.mode.relaid()
    person.menu("Begin")
    person.wait(lambda: person.state() == "waiting" and bool(person.status.get("ready")), "the cloth")
    person.key(pygame.K_RETURN)
    person.wait(lambda: person.state() == "running", "the countdown")
    before, view = person.moment(), window.shop.place.view
    x, y = window.pane.pixel_of(before.corners[1], view.size)
    person.drag_pixel((x + view.left, y + view.top), (30, 90), frames=30, until=lambda: person.status["steps"] >= 8)
    after = person.moment()
    person.press("keep as success")
    person.wait(lambda: person.status.get("stored") == 1, "it to be kept")
    person.press("end the recording")
    (episode,) = stored_episodes(window.shop.folder / "hanger.h5")
    assert episode.source == "kinesthetic"
    # Down and forth, as it was led.
    moved = after.holder - before.holder
    assert moved[0] > 0.005
    assert moved[2] < -0.02
    # Nobody acts once the mouse has let go; how far the arm coasts in such a step is in no action.
    led = sum(step.hand_m is not None for step in episode.steps)
    assert led >= 8
    assert all(step.hand_m is not None for step in episode.steps[:led])
    made = np.array([step.action for step in episode.steps[:led]]).sum(axis=0)
    went = episode.observations()[led].holder_position - episode.steps[0].observation.holder_position
    np.testing.assert_allclose(made, went[[0, 2]], atol=1e-4)


def test_what_is_chosen_with_the_mouse_is_chosen(window):
    person = Person(window)
    person.choose(0, "keyboard")
    person.choose(1, "pickers")
    person.choose(2, "napkin")
    now = window.shop.settings
    assert (now.source, now.robot, now.cloth) == ("keyboard", "pickers", "napkin")
    person.write(1, "7")
    assert window.mode.seed in (7, 70)
    person.tab("Settings")
    person.choose(3, "double")
    noise = window.shop.settings.noise
    person.widget(ToggleSwitch)
    assert (window.shop.settings.speed, window.shop.settings.noise) == ("double", not noise)
    person.tab("Place")
    person.choose(0, "drag-rule")
    assert window.shop.settings.model == "drag-rule"
    person.choose(3, "keyboard")
    assert window.mode.source == "keyboard"
    (folder_file,) = window.shop.folder.iterdir()
    assert folder_file.name == "workstation.json"


def test_every_operation_on_data_has_its_menu(window, make_episode):
    with SessionRecorder(window.shop.folder / "demos.h5", robot="hanger", cloth="towel") as recorder:
        recorder.save(make_episode())
    person = Person(window)
    person.tab("Data")
    mode = window.mode
    assert isinstance(mode, DataPage)
    for name in list(OPERATIONS)[:6]:
        person.choose(1, name)
        person.look()
        assert mode.operation == name
    for name in OPERATIONS:
        mode.operation, mode.values = name, {}
        mode.build()
        person.look()
        assert mode.arguments()[:3] == ["data", name, str(window.shop.folder / "demos.h5")]


def test_leaving_a_running_demonstration_is_asked_twice(window):
    person = Person(window)
    set_up(window, "pickers")
    person.plug_in()
    person.menu("Begin")
    person.begin()
    person.demonstrate(0, n_steps=6)
    area = next(area for area, mode in window.tabs if mode.name == "Data")
    person.click(area.center)
    assert window.mode.name == "Record"
    assert "click again" in window.shop.message
    person.click(area.center)
    assert window.mode.name == "Data"
    (partial,) = stored_episodes(window.shop.folder / "pickers.h5")
    assert (partial.outcome, partial.stopped_by) == ("partial", "interrupted")


def test_a_window_of_any_size_is_drawn_and_a_smaller_one_than_the_least_is_not_made(window):
    person = Person(window)
    for size in ((960, 600), (1600, 900), (700, 400)):
        pygame.display.set_mode(size, pygame.RESIZABLE)
        window._resize()
        for mode in window.modes:
            person.tab(mode.name)
            person.look()
        assert window.surface.get_width() >= LEAST[0]
        assert window.surface.get_height() >= LEAST[1]
        assert window.shop.place.window.size == window.surface.get_size()


def test_only_what_has_changed_is_drawn_again(window, monkeypatch):
    person = Person(window)
    person.tab("Place")
    person.watch(0.3)
    drawn: list[int] = []
    monkeypatch.setattr(pygame.display, "update", lambda areas: drawn.append(len(areas)))
    for _ in range(10):
        person.look()
    # A menu's cursor may blink; the bench, the camera and the curves stay as they are.
    assert sum(drawn) <= 2
