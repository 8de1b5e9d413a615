"""The workstation in a browser: real clicks in Chromium on `layflat app`, which is a process of its own."""

from __future__ import annotations

import json
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


@pytest.fixture(autouse=True)
def _closed_pages(browser: playwright.Browser) -> Iterator[None]:
    """Pages that are left open would draw on, and take the time of the next tests."""
    yield
    for context in browser.contexts:
        context.close()


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


@pytest.mark.parametrize("size", [(1280, 720), pytest.param((390, 844), marks=pytest.mark.slow)])
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


@pytest.mark.slow
def test_every_command_has_a_form_and_runs(folder, serve, browser):
    person = BrowserPerson(browser, address_of(serve(folder)))
    person.tab("Data")
    person.page.get_by_text("Commands").click()
    for command, label in (
        ("validate", None), ("stats", None), ("split", "Share"), ("filter", "Min contact"), ("merge", "With"),
        ("trim", "Stop"), ("repair", "Out"), ("export", "Form"), ("import", "File"), ("video", "Episode"),
        ("plot", "Out"), ("info", None),
    ):  # fmt: skip
        person.choose("Command", command)
        if label is not None:
            person.field(label).wait_for()
    person.press("Run")
    person.sees("3 episodes|episodes +3", 60)
    assert person.alerts() == []
    assert person.errors == []


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


@pytest.mark.slow
def test_a_click_into_the_curves_goes_to_its_step_in_both_episodes(folder, serve, browser):
    person = BrowserPerson(browser, address_of(serve(folder)))
    person.tab("Replay")
    person.choose("Episode", "demo_0")
    person.choose("Beside it", "demo_2")
    curve = person.page.get_by_role("img", name="contact (%) over time")
    wait(lambda: curve.locator("path[fill=none]").count() == 2, "a line for each of both episodes")
    person.press("end")
    person.sees("step 6 of 6")
    box = curve.bounding_box()
    for share, step in ((0.0, 0), (1.0, 6), (0.5, 3)):
        x = box["x"] + box["width"] * (26 + share * 268) / 300
        person.page.mouse.click(x, box["y"] + box["height"] / 2)
        person.sees(f"step {step} of 6")
        wait(lambda share=share: _cursor(curve) == pytest.approx(26 + share * 268, abs=0.1), "the line of the moment")
    assert person.errors == []
    person.close()


def _cursor(curve: playwright.Locator) -> float:
    found = re.match(r"M([\d.]+) ", str(curve.locator("path.lf-now").get_attribute("d")))
    assert found is not None
    return float(found[1])


@pytest.mark.slow
def test_dark_pages_are_offered_and_kept(folder, serve, browser):
    server = serve(folder)
    person = BrowserPerson(browser, address_of(server))
    scheme = "document.documentElement.dataset.mantineColorScheme"
    assert person.page.evaluate(scheme) == "light"
    person.tab("Settings")
    person.page.get_by_label("Dark pages").check()
    wait(lambda: person.page.evaluate(scheme) == "dark", "the dark theme")
    second = BrowserPerson(browser, address_of(server))
    wait(lambda: second.page.evaluate(scheme) == "dark", "the dark theme for the next viewer")
    assert json.loads((folder / "workstation.json").read_text())["dark"] is True


@pytest.mark.slow
def test_on_a_phone_scene_and_page_share_the_screen(folder, serve, browser):
    person = BrowserPerson(browser, address_of(serve(folder)), (390, 844))
    for name in PAGES:
        person.tab(name)
        scene = person.page.locator("canvas").first.bounding_box()
        sheet = person.page.locator(".mantine-Paper-root:has(.lf-tabs)").bounding_box()
        assert (sheet["x"], sheet["width"]) == (0, 390), name
        assert abs(scene["y"] + scene["height"] - sheet["y"]) <= 1, name
        assert 844 - sheet["y"] - sheet["height"] == pytest.approx(0, abs=1), name


OWN_POLICY = """
import numpy as np
from layflat import Decision

class Lower:
    def __init__(self, spec):
        self.down = np.array([-0.02 if axis.coordinate.startswith("z") else 0.0 for axis in spec.robot.axes])
    def reset(self, seed): ...
    def act(self, observation):
        return Decision(action=self.down, stop="threshold" if observation.time_s > 0.4 else None)
"""


@pytest.fixture
def own_policy(tmp_path, monkeypatch) -> str:
    """Name of a policy of the user's, in the folder from which programs are started."""
    (tmp_path / "lower_19.py").write_text(OWN_POLICY)
    monkeypatch.chdir(tmp_path)
    return "lower_19:Lower"


@pytest.mark.slow
def test_a_policy_of_ones_own_is_placed(folder, serve, browser, own_policy):
    person = BrowserPerson(browser, address_of(serve(folder)))
    person.tab("Place")
    person.choose("Policy", "one of your own")
    for text, problem in (
        ("../secret.npz", "'../secret.npz' is not package.module:factory"),
        ("no_such_19:Lower", "cannot be imported, ModuleNotFoundError"),
        ("ws://127.0.0.1:9", "127.0.0.1:9"),
    ):
        person.write("Its name", text)
        person.press("Place")
        person.sees(re.escape(problem))
        person.button("Place").wait_for()
    person.write("Its name", own_policy)
    person.press("Place")
    person.sees("Stopped: 0 %, in the air", 120)
    person.sees("lower_19.Lower")
    assert person.errors == []


@pytest.mark.slow
def test_a_policy_of_ones_own_is_evaluated(folder, serve, browser, own_policy):
    person = BrowserPerson(browser, address_of(serve(folder)))
    person.tab("Evaluate")
    person.write("Your own", "/etc/passwd")
    person.press("Evaluate")
    person.sees("'/etc/passwd' is not package.module:factory")
    person.write("Your own", own_policy)
    person.write("Starts", "1")
    person.write("Folder", "own")
    person.press("Evaluate")
    person.sees("Show the report", 180)
    person.sees("lower_19.Lower")
    assert (folder / "own" / "report.html").exists()


def test_layflat_place_takes_a_policy_of_ones_own(tmp_path, start_program, own_policy):
    found = tmp_path / "placed.json"
    program = start_program("layflat.app.cli.main", "place", own_policy, "--robot", "hanger", "--json", found)
    assert program.wait(120) == 0, program.err
    (episode,) = json.loads(found.read_text())["episodes"]
    assert (episode["policy"], episode["stopped_by"]) == ("lower_19.Lower", "threshold")


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_session_a_model_or_a_result_that_vanishes_is_a_sentence_on_its_page(folder, serve, browser):
    (folder / "model.npz").touch()
    (folder / "compared").mkdir()
    (folder / "compared" / "episodes.csv").touch()
    person = BrowserPerson(browser, address_of(serve(folder)))
    gone = "is not in .* any more; choose another one"
    person.tab("Train")
    person.page.wait_for_timeout(300)
    (folder / "demos.h5").rename(folder / "demos.gone")
    person.press("Train")
    person.sees(f"demos.h5 {gone}")
    (folder / "demos.gone").rename(folder / "demos.h5")
    person.tab("Replay")
    person.sees("step . of 6")
    (folder / "demos.h5").unlink()
    person.choose("Episode", "demo_0")
    person.sees(f"demos.h5 {gone}")
    person.tab("Evaluate")
    (folder / "compared" / "episodes.csv").unlink()
    person.press("Show the report")
    person.sees(f"compared {gone}")
    person.tab("Place")
    person.choose("Policy", "model.npz")
    (folder / "model.npz").unlink()
    person.press("Place")
    person.sees(f"model.npz {gone}")
    assert person.errors == []


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.skipif(os.geteuid() == 0, reason="root can write everywhere")
def test_a_folder_that_is_read_only_can_be_looked_at(folder, serve, browser):
    folder.chmod(0o555)
    try:
        server = serve(folder)
        person = BrowserPerson(browser, address_of(server))
        assert f"layflat: {folder} cannot be written; it can only be looked at" in server.err
        person.sees("cannot be written; look at it in Replay and Data")
        person.tab("Replay")
        person.sees("step . of 6")
        person.tab("Train")
        person.press("Train")
        person.sees("cannot be written; it can only be looked at")
        assert person.errors == []
    finally:
        folder.chmod(0o755)


def test_without_a_browser_the_address_is_enough(tmp_path, start_program, monkeypatch):
    monkeypatch.setenv("DISPLAY", ":97")
    monkeypatch.setenv("BROWSER", str(tmp_path / "no-such-browser"))
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("SDL_VIDEODRIVER", raising=False)
    server = start_program("layflat.app.cli.main", "app", "--folder", tmp_path / "runs", "--port", 0)
    address_of(server)
    server.until("layflat: no browser could be opened; open the address above yourself")


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
    person.page.get_by_role("img", name="Learned displacements").wait_for()
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
