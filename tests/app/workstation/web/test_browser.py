"""The workstation in a browser: real clicks in Chromium on `layflat app`, which is a process of its own."""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

from layflat.data.session.editor import SessionEditor  # noqa: E402
from layflat.data.session.reader import open_session  # noqa: E402
from layflat.data.session.recorder import SessionRecorder  # noqa: E402
from layflat.sim.robots.registry import robot_spec  # noqa: E402
from layflat.tests.app.program import Program  # noqa: E402
from layflat.tests.app.workstation.web.browser_person import (  # noqa: E402
    SOFTWARE,
    BrowserPerson,
    address_of,
    needs_browser,
    wait,
)
from layflat.tests.browser import CHROMIUM  # noqa: E402

pytestmark = [needs_browser, pytest.mark.timeout(400)]
PAGES = ("Record", "Train", "Place", "Replay", "Data", "Evaluate", "Settings")


@pytest.fixture(scope="module")
def browser() -> Iterator[playwright.Browser]:
    with playwright.sync_playwright() as started:
        opened = started.chromium.launch(executable_path=CHROMIUM, args=list(SOFTWARE))
        yield opened
        opened.close()


@pytest.fixture
def folder(tmp_path: Path, make_episode: Callable, lying: Callable) -> Path:
    """With a session of three short episodes, the second a failure."""
    path = tmp_path / "runs"
    path.mkdir()
    with SessionRecorder(path / "demos.h5", robot=robot_spec("hanger"), cloth="towel") as recorder:
        for seed, outcome in enumerate(["success", "failure", "success"]):
            recorder.save(lying(make_episode(seed=seed, outcome=outcome)))
    return path


@pytest.fixture
def serve(start_program: Callable[..., Program]) -> Callable[[Path], Program]:
    return lambda path: start_program("layflat.app.cli.main", "app", "--folder", path, "--port", 0, "--no-open")


@pytest.mark.parametrize("size", [(1280, 720), (390, 844)])
def test_every_page_opens_without_an_error(folder, serve, browser, size):
    server = serve(folder)
    person = BrowserPerson(browser, address_of(server), size)
    for name in PAGES:
        person.tab(name)
        person.page.wait_for_timeout(700)
        assert person.alerts() == []
        assert person.page.evaluate("document.documentElement.scrollWidth <= innerWidth"), name
    assert person.errors == []
    person.close()
    server.interrupt()


def test_episodes_are_edited_by_clicks(folder, serve, browser):
    """Relabel, note, drop, restore and undo, each durable when it is said."""
    server = serve(folder)
    person = BrowserPerson(browser, address_of(server))
    person.tab("Data")
    person.page.locator("tr[data-name=demo_0]").click()
    wait(lambda: person.field("Episode").input_value() == "demo_0", "the row's name in the field")
    person.press("failure")
    person.sees("relabel demo_0 failure: done")
    with open_session(folder / "demos.h5") as session:
        assert [info.outcome for info in session.infos().values()] == ["failure", "failure", "success"]
    person.write("Note", "<b>hem</b> folded")
    person.press("Keep the note")
    person.sees("note demo_0")
    person.page.get_by_text("<b>hem</b> folded").first.wait_for()
    person.press("Drop")
    person.sees("drop demo_0: done")
    wait(lambda: person.page.locator("tr[data-name=demo_0]").count() == 0, "the row to go")
    person.press("Undo the last edit")
    person.page.locator("tr[data-name=demo_0]").wait_for()
    assert [edit.kind for edit in SessionEditor(folder / "demos.h5").log().edits] == ["relabel", "note", "drop", "undo"]
    person.choose("Sort by", "outcome")
    wait(lambda: _rows(person) == ["demo_0", "demo_1", "demo_2"], "the failures first")
    person.tab("Train")
    person.sees("1 of 3 episodes are successes")
    assert person.errors == []
    server.interrupt()


def _rows(person: BrowserPerson) -> list[str]:
    return [str(row.get_attribute("data-name")) for row in person.page.locator("tr[data-name]").all()]


def test_two_episodes_are_replayed_side_by_side(folder, serve, browser):
    person = BrowserPerson(browser, address_of(serve(folder)))
    person.tab("Replay")
    person.choose("Episode", "demo_0")
    person.choose("Beside it", "demo_2")
    person.press("end")
    person.sees("step 6 of 6")
    person.press("previous")  # There is none before the first.
    person.press("-1")
    person.sees("step 5 of 6")
    assert person.errors == []
    person.close()


def test_a_file_that_vanishes_while_it_is_shown_is_a_sentence(folder, serve, browser):
    person = BrowserPerson(browser, address_of(serve(folder)))
    person.tab("Data")
    person.page.locator("tr[data-name=demo_0]").click()
    (folder / "demos.h5").unlink()
    person.press("failure")
    person.sees(r"demos.h5 is not in .* any more; choose another one")
    person.tab("Data")
    person.sees("There is no session in this folder; record one first")
    person.close()


def test_only_one_viewer_is_in_control_and_a_take_pauses_without_them(folder, serve, browser):
    """A second viewer watches and takes control; a reload in the middle pauses the take, which then continues."""
    server = serve(folder)
    address = address_of(server)
    first = BrowserPerson(browser, address)
    first.tab("Place")
    first.press("Place")
    first.sees("Placing", 120)
    first.press("Pause")
    first.sees("Paused")
    second = BrowserPerson(browser, address)
    second.sees("viewer 1 is in control; you watch")
    second.press("Continue")
    second.sees("viewer 1 is in control; press Take control to act yourself")
    second.press("Take control")
    first.sees("viewer 2 is in control; you watch")
    second.press("Continue")
    first.sees("Placing")
    second.page.reload()
    first.sees("viewer 2, who was in control, is gone; the take is paused")
    second.button("Continue").wait_for()
    second.press("Continue")
    first.sees("viewer 3 is in control; you watch")
    first.sees("Placing")
    assert first.errors == second.errors == []
    os.kill(server.process.pid, signal.SIGTERM)
    assert server.wait(60) == 130
    assert server.none_left()
    assert "Traceback" not in server.err


def record_a_little(person: BrowserPerson, folder: Path) -> None:
    """Guide the hanger down a little with the arrows, from an empty folder."""
    person.press("Begin")
    person.button("Start seed").click()
    person.page.get_by_text("Go", exact=True).wait_for()
    person.page.wait_for_timeout(1000)
    # The arrows are in the middle of the view, and the hanger's points up.
    for y in range(150, 320, 6):
        x = 499
        person.page.mouse.move(x, y)
        person.page.wait_for_timeout(60)
        person.page.mouse.down()
        for k in range(8):
            person.page.mouse.move(x, y + 5 * k)
            person.page.wait_for_timeout(60)
        moved = person.button("Discard this one").count() > 0
        person.page.mouse.up()
        if moved:
            return
    raise AssertionError("nothing was grabbed")


def test_a_demonstration_by_hand_survives_the_server(tmp_path, serve, browser):
    """One is kept after a question, a second one is discarded and brought back; then the server is killed."""
    server = serve(tmp_path)
    person = BrowserPerson(browser, address_of(server))
    record_a_little(person, tmp_path)
    person.press("Keep as success")
    person.sees("in the air")
    person.press("Yes")
    person.sees("kept demo_0 success")
    person.button("Start seed 1").click()
    person.page.get_by_text("Go", exact=True).wait_for()
    server.kill()
    assert server.none_left(40)
    with open_session(tmp_path / "demos.h5") as session:
        assert session.names == ("demo_0",)
        assert session.info("demo_0").source == "kinesthetic"


@pytest.mark.parametrize("how", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_it_ends_cleanly(tmp_path, serve, how):
    server = serve(tmp_path / "new")
    address_of(server)
    os.kill(server.process.pid, getattr(signal, how))
    assert server.wait(60) == 130
    assert server.err.splitlines()[-1].startswith("layflat: interrupted")
    assert server.none_left()


def test_a_port_in_use_is_a_sentence(tmp_path, serve, start_program):
    port = re.search(r":(\d+)/", address_of(serve(tmp_path)))[1]
    second = start_program("layflat.app.cli.main", "app", "--folder", tmp_path, "--port", port, "--no-open")
    assert second.wait(60) == 2
    assert (
        second.err == f"layflat: port {port} of 127.0.0.1 is in use; choose another with --port, or end what uses it\n"
    )


def test_a_folder_that_cannot_be_made_is_a_sentence(tmp_path, serve):
    (tmp_path / "file").touch()
    server = serve(tmp_path / "file")
    assert server.wait(60) == 2
    assert server.err.startswith("layflat: ")
    assert "choose another folder" in server.err


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["hanger", "pickers"])
def test_an_afternoon_from_an_empty_folder_to_a_repaired_cloth(tmp_path, serve, browser, robot):
    server = serve(tmp_path)
    person = BrowserPerson(browser, address_of(server))
    person.choose("Robot", robot)
    person.choose("By", "scripted")
    person.write("Number to keep", "3")
    person.press("Begin")
    wait(lambda: (tmp_path / "demos.h5").exists(), "the session", 180)
    person.sees("3 success", 180)
    person.tab("Train")
    person.sees("3 of 3 episodes are successes")
    person.press("Train")
    person.sees("the model is chosen on the page Place", 180)
    assert (tmp_path / "demos-gp-word.npz").exists()
    person.tab("Place")
    assert person.field("Policy").input_value() == "demos-gp-word.npz"
    person.choose("Record into", "demos.h5")
    person.page.get_by_label("Place quickly").check()
    person.press("Place")
    person.sees("(Placed|Stopped): ", 180)
    person.press("push")
    person.sees("disturbed by", 60)
    person.sees("Repairing", 120)
    person.sees("(Placed|Stopped): ", 240)
    person.press("Keep as success")
    person.page.wait_for_timeout(1500)
    if person.page.get_by_role("button", name="Yes", exact=True).count():
        person.press("Yes")
    person.sees("kept demo_3 success", 60)
    person.press("End")
    person.tab("Data")
    person.page.locator("tr[data-name=demo_3]").click()
    person.press("Film")
    person.page.locator("video").wait_for(timeout=180_000)
    person.tab("Evaluate")
    person.page.get_by_label("demos-gp-word.npz").check()
    person.write("Starts", "2")
    person.write("Folder", "compared")
    person.press("Evaluate")
    person.sees("Results", 300)
    person.press("Show the report")
    person.page.frame_locator("iframe[title=Report]").get_by_role("heading").first.wait_for()
    assert person.errors == []
    server.interrupt()
