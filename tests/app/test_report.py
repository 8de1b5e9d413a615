"""The report is one page that needs nothing else, shows every run, and keeps its numbers straight."""

from __future__ import annotations

import base64
import re
import shutil
import subprocess
from dataclasses import replace

import cv2
import numpy as np
import pytest

from layflat.app.media import frames
from layflat.app.media.video import count_frames
from layflat.app.report import figures, tables, thesis_numbers
from layflat.app.report.demo import ReportInput, RobotResults, pictured_run, write_report
from layflat.app.support.provenance import capture_provenance

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@pytest.fixture(scope="module")
def hanger(make_episode, make_model):
    demonstrations = [make_episode(source="scripted", seed=s, disturbed=False) for s in range(3)]
    return RobotResults(
        robot="hanger",
        cloth="towel",
        demonstrations=tuple(demonstrations),
        models={
            "gp-baseline": make_model("hanger", "position", demonstrations),
            "gp-word": make_model("hanger", "all", demonstrations),
        },
        runs={
            "gp-word": tuple(make_episode(seed=s, images=s == 0) for s in range(3)),
            "gp-baseline": tuple(make_episode(source="gp-baseline", seed=s, gain=0.0, images=s == 0) for s in range(3)),
        },
    )


def _written(path, *robots) -> str:
    write_report(path, ReportInput(robots=robots, provenance=capture_provenance(), seed=0, notes=("a <note>",)))
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def report(tmp_path_factory, hanger):
    """One page for all tests that only read it; one of its runs went wrong."""
    path = tmp_path_factory.mktemp("report") / "report.html"
    bad = replace(hanger.runs["gp-word"][2], seed=4711, stopped_by="unstable", outcome="failure")
    _written(path, replace(hanger, runs={**hanger.runs, "gp-word": (*hanger.runs["gp-word"], bad)}))
    return path


def test_the_page_is_self_contained(report):
    page = report.read_text(encoding="utf-8")
    assert [p.name for p in report.parent.iterdir()] == ["report.html"]
    text = re.sub(r"data:[a-z/]+;base64,[A-Za-z0-9+/=]+", "DATA", page)
    assert not re.search(r"https?://|<script|<link(?! rel=\"icon\" href=\"data:)|@import|url\(", text)
    assert set(re.findall(r"src=\"([^\"]*)\"", text)) == {"DATA"}
    assert "a &lt;note&gt;" in text


def test_every_picture_and_film_decodes(tmp_path, report, hanger):
    page = report.read_text(encoding="utf-8")
    pictures = re.findall(r"data:image/[a-z]+;base64,([A-Za-z0-9+/=]+)", page)
    assert len(pictures) == 2 * 2 * frames.STRIP_FRAMES + 2
    for picture in pictures:
        assert cv2.imdecode(np.frombuffer(base64.b64decode(picture), np.uint8), cv2.IMREAD_COLOR) is not None
    films = re.findall(r"data:video/webm;base64,([A-Za-z0-9+/=]+)", page)
    assert len(films) == 2
    film = tmp_path / "film.webm"
    film.write_bytes(base64.b64decode(films[0]))
    assert count_frames(film) == len(hanger.runs["gp-word"][0].steps) + 1


def test_a_robot_without_images_or_disturbance_or_models_still_makes_a_page(tmp_path, make_episode):
    runs = {"drag-rule": (make_episode(robot="pickers", source="drag-rule", disturbed=False),)}
    results = RobotResults(robot="pickers", cloth="napkin", demonstrations=(), models={}, runs=runs)
    page = _written(tmp_path / "report.html", results)
    assert "Pickers robot" in page
    assert "Hanger robot" not in page
    assert "<video" not in page
    assert "Disturbance and repair" not in page


def test_a_robot_with_nothing_at_all_makes_a_page(tmp_path):
    empty = RobotResults(robot="hanger", cloth="towel", demonstrations=(), models={}, runs={"gp-word": ()})
    assert "0 of 0" in _written(tmp_path / "report.html", empty)


def test_tables_hold_the_means_of_the_runs(hanger):
    runs = hanger.runs
    table = tables.disturbance_table(runs)
    ours = {row[0]: row for row, own in zip(table.rows, table.ours, strict=True) if own}
    assert ours["gp-word"][5] == "+8.0"
    assert ours["gp-baseline"][5] == "+0.0"
    assert ours["gp-word"][1] == "3"
    placed = np.mean([100 * run.contact()[run.phase_bounds("place")[1]] for run in runs["gp-word"]])
    placing = {row[0]: row for row in tables.placing_table(runs).rows}
    assert placing["gp-word"][3] == f"{placed:.1f} %"
    assert placing["gp-word, thesis"][2:5] == ("98.3 %", "96.5 %", "91.5 %")
    assert all(len(row) == len(table.header) for row in table.rows)


def test_thesis_gains_are_those_it_states():
    """Chapter 4-3-3: the baseline changes by less than 1 %, the proposed method gains around 5 to 10 %."""
    for policy, low, high in ((thesis_numbers.BASELINE, -0.01, 0.01), (thesis_numbers.PROPOSED, 0.045, 0.11)):
        assert all(low < final - disturbed < high for _, disturbed, final in tables.THESIS_DISTURBANCE[policy])


def test_every_run_is_in_the_page(report):
    page = report.read_text(encoding="utf-8")
    assert "4711" in page
    assert "unstable" in page


def test_strips_show_start_stop_disturbance_and_end(make_episode):
    episode = make_episode(images=True)
    placing = frames.frame_strip(episode, frames.placing_steps(episode), frames.draw_plain, 80)
    assert (len(placing), placing[0].word, placing[-1].word) == (10, "start", "stopped")
    disturbance = frames.frame_strip(episode, frames.disturbance_steps(episode), frames.draw_plain, 80)
    assert [frame.word for frame in disturbance] == [
        "start", "placing", "stopped", "disturbance", "disturbed", *["repair"] * 4, "end",
    ]  # fmt: skip
    assert [frame.step for frame in disturbance] == sorted(frame.step for frame in disturbance)
    assert {frame.image.shape[1] for frame in placing} == {80}


def test_strips_take_the_nearest_frame_that_has_an_image(make_episode):
    episode = make_episode(images=True)
    steps = tuple(
        replace(step, observation=replace(step.observation, rgb=None)) if step_index % 7 else step
        for step_index, step in enumerate(episode.steps)
    )
    shown = frames.frame_strip(replace(episode, steps=steps), [0, 6, 10], frames.draw_plain, 80)
    assert [frame.step for frame in shown] == [0, 7, 7]


def test_the_run_that_is_pictured_has_images_and_a_disturbance(make_episode):
    plain, seen = make_episode(seed=1), make_episode(seed=2, images=True, disturbed=False)
    both = make_episode(seed=3, images=True)
    assert pictured_run([plain, seen, both]) is both
    assert pictured_run([plain, seen]) is seen
    assert pictured_run([plain]) is None


def test_the_field_is_the_model_at_the_demonstrated_cloth_state(make_episode, make_model):
    demonstrations = [make_episode(robot="pickers", source="scripted", disturbed=False)]
    model = make_model("pickers", "all", demonstrations)
    asked = []

    class Spy:
        layout = model.layout

        def predict(self, inputs):
            asked.append(inputs)
            return model.predict(inputs)

    panel = figures.SubplotSpec(model=Spy(), title="", held={"contact": 0.8})
    x, z, dx, dz, _ = figures.field_of("pickers", panel, demonstrations)
    names = model.layout.names
    assert np.allclose(asked[0][:, names.index("x1")], x.ravel())
    assert np.allclose(asked[0][:, names.index("z1")], z.ravel())
    assert (asked[0][:, names.index("contact")] == 0.8).all()
    mean, _ = model.predict(asked[0])
    assert np.allclose(dx.ravel(), mean[:, 0])
    assert np.allclose(dz.ravel(), mean[:, 2])
    known = model.layout.matrix(demonstrations[0].steps)
    y2 = names.index("y2")
    assert (asked[0][:, y2] >= known[:, y2].min() - 1e-9).all()
    assert (asked[0][:, y2] <= known[:, y2].max() + 1e-9).all()


def test_the_mean_curve_is_the_mean_where_all_runs_have_begun(make_episode):
    group = [make_episode(seed=s) for s in range(4)]
    grid, mean = figures.mean_curve(group)
    at_disturbance = int(np.abs(grid).argmin())
    begin = group[0].phase_bounds("disturb")[0]
    assert mean[at_disturbance] == pytest.approx(np.mean([run.contact()[begin] for run in group]))
    assert mean[-1] == pytest.approx(np.mean([run.contact()[-1] for run in group]))


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium here")
def test_a_browser_lays_the_page_out(tmp_path, report):
    shot = tmp_path / "page.png"
    command = [str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"]
    command += [f"--user-data-dir={tmp_path / 'profile'}", "--window-size=1200,1600", f"--screenshot={shot}"]
    subprocess.run([*command, report.as_uri()], check=True, capture_output=True, timeout=60)
    image = cv2.imread(str(shot))
    assert image.shape[:2] == (1600, 1200)
    assert image.std() > 20


def test_a_sheet_holds_every_frame_of_its_strips(make_episode):
    episode = make_episode(images=True)
    rows = [
        frames.frame_strip(episode, step_indices, frames.draw_plain, 80) for step_indices in ([0, 5, 10], [12, 15, 20])
    ]
    picture = frames.contact_sheet(rows)
    height, width = rows[0][0].image.shape[:2]
    assert picture.shape == (2 * (height + 4), 3 * (width + 4), 3)
    for j in range(2):
        for k in range(3):  # the lower half: the upper has the words on it
            top, left = j * (height + 4) + height // 2, k * (width + 4)
            shown = picture[top : top + height - height // 2, left : left + width]
            np.testing.assert_array_equal(shown, rows[j][k].image[height // 2 :])
    with pytest.raises(ValueError, match="one length"):
        frames.contact_sheet([rows[0], rows[1][:2]])
