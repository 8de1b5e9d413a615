"""A person uses the whole window: a virtual gamepad, the mouse, and what is on disk."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pygame
import pytest
from pygame_menu.widgets import ToggleSwitch

from layflat.app.workstation.session.activities import make_activity
from layflat.app.workstation.window.layout import MIN_SIZE
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
from layflat.tests.factories import HANGER

pytestmark = pytest.mark.timeout(400)


@pytest.fixture
def window(tmp_path: Path) -> Iterator[Window]:
    headless()
    made = Window(tmp_path, make_activity)
    made.context.change_settings(replace(made.context.settings, speed="as fast as possible", countdown_s=0.3))
    made.page.on_resize()
    yield made
    # SDL crashes where it ends before a gamepad does.
    unplug_all()
    made.close()
    assert leftovers() == []


def leftovers() -> list[str]:
    """Return child processes that still run, other than Python's own fork server and tracker."""
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
    window.context.change_settings(replace(window.context.settings, robot=robot, session=f"{robot}.h5"))
    window.page.on_resize()


def stored_episodes(path: Path) -> list[Episode]:
    assert not validate(path)
    with open_session(path) as session:
        return [session.episode(name) for name in session.names]


def record_three(person: Person, n_steps: int | None) -> list[int]:
    """Keep one, discard one, keep one with a disconnect in its middle; return the numbers of steps of those kept."""
    pad, lengths = person.plug_in(), []
    person.menu("Start")

    def keep() -> None:
        before, n_steps = person.status["n_episodes"], int(person.status["steps"])
        person.pad.tap("triangle")
        person.wait(lambda: person.status.get("n_episodes") == before + 1, "it to be kept")
        kept = re.search(r"kept demo_\d success (\d+) steps", person.window.context.message)
        assert int(kept[1]) >= n_steps
        lengths.append(int(kept[1]))

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
    assert "was disconnected" in person.window.input_manager.describe()
    at = person.status["steps"]
    person.watch(0.5)
    assert person.status["steps"] == at, "time does not pass without a device"
    person.plug_in()
    person.wait(lambda: person.state() == "running", "it to go on")
    person.demonstrate(2, n_steps=n_steps)
    keep()
    person.pad.tap("ps")
    person.wait(lambda: not person.window.page.running, "the end of the recording")
    return lengths


def check_recorded(path: Path, robot: str, lengths: list[int]) -> None:
    """The file holds exactly what was kept."""
    episodes = stored_episodes(path)
    assert [(e.outcome, e.source, e.robot.name, e.seed) for e in episodes] == [
        ("success", "gamepad", robot, 0),
        ("success", "gamepad", robot, 2),
    ]
    assert [len(episode.steps) for episode in episodes] == lengths
    for episode in episodes:
        actions = np.array([step.action for step in episode.steps])
        assert actions.shape[1] == robot_spec(robot).size
        assert 0 < np.abs(actions).max() <= ACTION_LIMIT_M
        times = [seen.time_s for seen in episode.observations()]
        np.testing.assert_allclose(np.diff(times), episode.step_s, atol=1e-9)
        assert not any(step.drag for step in episode.steps)


def train(person: Person, session: str) -> str:
    person.tab("Train")
    page = person.window.page
    assert isinstance(page, TrainPage)
    page.session, page.model = session, "learned.npz"
    page.overwrite = True
    page.build()
    person.menu("Train")
    person.wait(lambda: page.command is not None and page.command.status is not None, "training", 300.0)
    assert page.command.status == 0, list(page.command.lines)
    person.look()
    return page.model


def place_and_pull(person: Person, n_steps: int | None) -> int | None:
    """Place with the trained model into a session of its own, and drag the cloth; return the node under the mouse."""
    person.tab("Place")
    page = person.window.page
    assert isinstance(page, PlacePage)
    assert person.window.context.settings.model == "learned.npz"
    page.seed, page.record = 9, "placed"
    page.build()
    person.menu("Place")
    person.wait(lambda: person.state() == "placing" and person.status["steps"] >= 3, "it to begin")
    if n_steps is None:
        person.wait(lambda: person.state() == "placed", "it to be placed", 90.0)
    frame = person.seen()
    pulled = person.drag_node(45, (-50, -40), frames=10, until=lambda: person.status["drag_steps"] >= 4)
    if n_steps is None:
        person.wait(lambda: person.state() == "repairing", "the repair")
        person.wait(lambda: person.state() == "placed", "the repair's end", 60.0)
    person.key(pygame.K_2)
    person.wait(lambda: person.status["disturbances"] == ["pull"], "the disturbance")
    person.wait(lambda at=person.status["steps"]: person.status["steps"] > at + 3, "it to act")
    person.press("keep")
    person.wait(lambda: page.finished, "it to be kept")
    page.stop()
    assert frame is not None
    assert pulled is not None
    # A fold may hide the node that is aimed at; the node that is dragged instead is seen there.
    aimed, taken = (person.window.viewport.camera.project(frame.nodes[[k]], (700, 600))[0][0] for k in (45, pulled))
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
    page = person.window.page
    assert isinstance(page, ReplayPage)
    page.session = session
    page.build()
    person.menu("Watch")
    assert page.playback is not None
    last = page.playback.last
    person.wait(lambda: page.at > 0, "it to play")
    bar = page.bar()
    person.click((bar.left + 16 + (bar.width - 32) // 2, bar.centery))
    assert page.at == pytest.approx(last / 2, abs=1)
    np.testing.assert_array_equal(page.frame().nodes, page.playback.episode.ground_truths()[page.at].nodes)
    person.key(pygame.K_END)
    assert page.at == last


def use_it_all(window: Window, robot: str, n_steps: int | None) -> None:
    person = Person(window)
    set_up(window, robot)
    folder = window.context.folder
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
    episodes = stored_episodes(window.context.folder / f"{robot}.h5")
    # The person laid it: the demonstrations are what their verdict says.
    assert all(episode.final_ground_truth.flat_area > 0.9 for episode in episodes)


def test_a_simulation_that_dies_costs_one_demonstration(window):
    person = Person(window)
    set_up(window, "pickers")
    person.plug_in()
    person.menu("Start")
    person.begin()
    person.demonstrate(0, n_steps=10)
    (take,) = psutil.Process(window.context.client.pid).children()
    take.kill()
    person.pad.axis("left_y", 0.5)
    person.wait(lambda: person.status["counts"]["partial"] == 1, "the loss")
    assert "was lost" in person.status["message"]
    # The same start again, and the device still works.
    person.pad.axis("left_y", 0.0)
    person.begin()
    person.demonstrate(0, n_steps=6)
    person.pad.tap("triangle")
    person.wait(lambda: person.status["n_episodes"] == 2, "it to be kept")
    person.key(pygame.K_ESCAPE)
    assert not window.page.running
    partial, whole = stored_episodes(window.context.folder / "pickers.h5")
    assert (partial.outcome, partial.stopped_by, whole.outcome) == ("partial", "crashed", "success")
    assert len(partial.steps) >= 8


def test_an_activity_that_dies_is_reported_and_the_menu_is_back(window):
    person = Person(window)
    set_up(window, "pickers")
    person.plug_in()
    person.menu("Start")
    person.begin()
    person.demonstrate(0, n_steps=10)
    bench = psutil.Process(window.context.client.pid)
    family = [bench, *bench.children(recursive=True)]
    bench.kill()
    person.wait(lambda: isinstance(window.page, RecordPage) and not window.page.running, "the menu")
    assert "SIGKILL" in window.context.message
    psutil.wait_procs(family, timeout=40)
    assert leftovers() == []
    # The next recording saves its steps.
    person.menu("Start")
    person.wait(lambda: person.status.get("n_episodes") == 1, "the recovered steps")
    window.page.stop()
    (partial,) = stored_episodes(window.context.folder / "pickers.h5")
    assert partial.outcome == "partial"


def test_the_hanger_is_guided_by_hand(window):
    """The mouse grabs the hanger, which is compliant; what it did is the action."""
    person = Person(window)
    set_up(window, "hanger")
    window.context.change_settings(replace(window.context.settings, source="kinesthetic"))
    window.page.on_resize()
    person.menu("Start")
    person.wait(lambda: person.state() == "waiting" and bool(person.status.get("ready")), "the cloth")
    person.key(pygame.K_RETURN)
    person.wait(lambda: person.state() == "running", "the countdown")
    before, view = person.seen(), window.context.layout.view
    x, y = window.viewport.pixel_of(before.corners[1], view.size)
    person.drag_pixel((x + view.left, y + view.top), (30, 90), frames=30, until=lambda: person.status["steps"] >= 8)
    after = person.seen()
    person.press("keep as success")
    person.wait(lambda: person.status.get("n_episodes") == 1, "it to be kept")
    person.press("end the recording")
    (episode,) = stored_episodes(window.context.folder / "hanger.h5")
    assert episode.source == "kinesthetic"
    # Down and forward, as it was guided.
    moved = after.holder - before.holder
    assert moved[0] > 0.005
    assert moved[2] < -0.02
    # After the release, no action has the distance that the arm coasts.
    n = sum(step.hand_m is not None for step in episode.steps)
    assert n >= 8
    assert all(step.hand_m is not None for step in episode.steps[:n])
    made = np.array([step.action for step in episode.steps[:n]]).sum(axis=0)
    went = episode.observations()[n].holder_position - episode.steps[0].observation.holder_position
    np.testing.assert_allclose(made, went[[0, 2]], atol=1e-4)


def test_choices_of_the_mouse_are_settings(window):
    person = Person(window)
    person.choose(0, "keyboard")
    person.choose(1, "pickers")
    person.choose(2, "napkin")
    now = window.context.settings
    assert (now.source, now.robot, now.cloth) == ("keyboard", "pickers", "napkin")
    person.write(1, "7")
    assert window.page.seed in (7, 70)
    person.tab("Settings")
    person.choose(3, "double")
    noise = window.context.settings.noise
    person.widget(ToggleSwitch)
    assert (window.context.settings.speed, window.context.settings.noise) == ("double", not noise)
    person.tab("Place")
    person.choose(0, "drag-rule")
    assert window.context.settings.model == "drag-rule"
    person.choose(3, "keyboard")
    assert window.page.source == "keyboard"
    (folder_file,) = window.context.folder.iterdir()
    assert folder_file.name == "workstation.json"


def test_every_operation_on_data_has_a_menu(window, make_episode):
    with SessionRecorder(window.context.folder / "demos.h5", robot=HANGER, cloth="towel") as recorder:
        recorder.save(make_episode())
    person = Person(window)
    person.tab("Data")
    page = window.page
    assert isinstance(page, DataPage)
    for name in list(OPERATIONS)[:6]:
        person.choose(1, name)
        person.look()
        assert page.operation == name
    for name in OPERATIONS:
        page.operation, page.values = name, {}
        page.build()
        person.look()
        assert page.arguments()[:3] == ["data", name, str(window.context.folder / "demos.h5")]


def test_leaving_a_running_demonstration_needs_a_second_request(window):
    person = Person(window)
    set_up(window, "pickers")
    person.plug_in()
    person.menu("Start")
    person.begin()
    person.demonstrate(0, n_steps=6)
    area = next(area for area, page in window.tabs if page.name == "Data")
    person.click(area.center)
    assert window.page.name == "Record"
    assert "click again" in window.context.message
    person.click(area.center)
    assert window.page.name == "Data"
    (partial,) = stored_episodes(window.context.folder / "pickers.h5")
    assert (partial.outcome, partial.stopped_by) == ("partial", "interrupted")


def test_a_window_of_any_size_is_drawn_but_not_below_the_smallest(window):
    person = Person(window)
    for size in ((960, 600), (1600, 900), (700, 400)):
        pygame.display.set_mode(size, pygame.RESIZABLE)
        window._resize()
        for page in window.pages:
            person.tab(page.name)
            person.look()
        assert window.surface.get_width() >= MIN_SIZE[0]
        assert window.surface.get_height() >= MIN_SIZE[1]
        assert window.context.layout.window.size == window.surface.get_size()


def test_only_changes_are_drawn(window, monkeypatch):
    person = Person(window)
    person.tab("Place")
    person.watch(0.3)
    drawn: list[int] = []
    monkeypatch.setattr(pygame.display, "update", lambda areas: drawn.append(len(areas)))
    for _ in range(10):
        person.look()
    # A menu's cursor may blink; the view, the image and the curves stay as they are.
    assert sum(drawn) <= 2
