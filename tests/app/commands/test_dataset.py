"""`layflat data`: output, files and refusals of every command on recorded sessions."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest

from layflat.app.cli import main
from layflat.app.commands.dataset_info import disturbances_text
from layflat.app.media.video import count_frames
from layflat.data import DisturbanceRecord, open_session
from layflat.tests.factories import without_ground_truth, write_session

COMMANDS = (
    "info", "validate", "stats", "split", "filter", "merge", "trim", "repair", "export", "import", "video", "plot",
)  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory, make_episode, lying) -> Path:
    """Sessions: ``hanger.h5`` (four episodes), ``more.h5`` (one), ``pickers.h5``, and files that are none."""
    folder = tmp_path_factory.mktemp("made")
    outcomes = [("success", False), ("failure", True), ("success", True), ("success", False)]
    sources = ["scripted", "scripted", "gamepad", "gamepad"]
    episodes = [
        make_episode(seed=seed, outcome=outcome, disturbed=disturbed, source=source)
        for seed, ((outcome, disturbed), source) in enumerate(zip(outcomes, sources, strict=True))
    ]
    write_session(folder / "hanger.h5", episodes)
    write_session(folder / "more.h5", [make_episode(seed=9, disturbed=False)])
    write_session(folder / "pickers.h5", [lying(make_episode(robot="pickers"), n_steps=5)])
    whole = (folder / "hanger.h5").read_bytes()
    (folder / "short.h5").write_bytes(whole[: len(whole) // 2])
    (folder / "text.h5").write_text("dear diary")
    return folder


@pytest.fixture
def folder(made, tmp_path, monkeypatch) -> Path:
    """A copy of ``made`` for one test, which is run in it."""
    for file in made.iterdir():
        shutil.copy(file, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def run(folder, capsys):
    """``run("info", "hanger.h5")``: exit status, stdout and stderr of ``layflat data info hanger.h5``."""

    def call(*arguments: str) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as stop:
            main.main(("data", *arguments))
        out, err = capsys.readouterr()
        return int(stop.value.code or 0), out, err

    return call


@pytest.fixture
def done(run):
    """The same for a call that must succeed; returns stdout."""

    def call(*arguments: str) -> str:
        status, out, err = run(*arguments)
        assert status == 0, err
        return out

    return call


def _seeds(path: str) -> list[int]:
    with open_session(path) as session:
        return [info.seed for info in session.infos().values()]


# What they do


def test_info_is_a_page(done):
    page = done("info", "hanger.h5", "--json", "info.json")
    for text in (
        "hanger.h5: 4 episodes, 310 steps", "robot hanger, task place, cloth towel", "3 success, 1 failure",
        "2 scripted, 2 gamepad", "2 none, 2 push", "contact at start", "demo_3",
    ):  # fmt: skip
        assert text in page
    assert max(map(len, page.splitlines())) <= 120
    report = json.loads(Path("info.json").read_text())
    assert report["schema"] == 1
    assert (report["steps"], report["outcomes"]) == (310, {"success": 3, "failure": 1})
    with open_session("hanger.h5") as session:
        for row, episode in zip(report["episodes"], session, strict=True):
            assert row["steps"] == len(episode.steps)
            assert row["contact_start"] == episode.contact()[0]
            assert row["contact_final"] == episode.contact()[-1]


def test_info_lists_disturbances_with_their_steps(done, make_episode):
    gusts = [DisturbanceRecord(name=name, first_step=step) for name, step in (("wind", 5), ("push", 40), ("wind", 80))]
    twice = [DisturbanceRecord(name="thesis", first_step=step, last_step=step + 9) for step in (60, 80)]
    gusty = make_episode(disturbance="gusts", disturbances=gusts)
    again = make_episode(disturbance="thesis", disturbances=twice)
    write_session(Path("some.h5"), [gusty, again, make_episode(disturbed=False)])
    page = " ".join(done("info", "some.h5", "--json", "some.json").split())
    found = [episode["disturbances"] for episode in json.loads(Path("some.json").read_text())["episodes"]]
    assert found[0][2] == {"name": "wind", "first_step": 80, "last_step": None}
    assert [record["last_step"] for record in found[1]] == [69, 89]
    assert found[2] == []
    assert disturbances_text("gusts", gusts) == "gusts: wind at 5, 80, push at 40"
    assert disturbances_text("none", []) == "none"
    assert disturbances_text("thesis", twice) == "thesis at 60, 80"
    assert "thesis at 60, 80" in page


def test_a_long_session_fits_on_a_page(done, make_episode, lying):
    write_session(Path("long.h5"), [lying(make_episode(seed=seed), n_steps=1) for seed in range(25)])
    page = done("info", "long.h5")
    assert len(page.splitlines()) < 50
    assert "5 more" in page
    assert "demo_0 " in page
    assert "demo_24" in page


def test_episodes_without_ground_truth_are_shown_and_exported(done, make_episode):
    write_session(Path("real.h5"), [without_ground_truth(make_episode(seed=seed)) for seed in range(2)])
    assert done("validate", "real.h5").startswith("valid")
    page = done("info", "real.h5", "--json", "info.json")
    assert "physics real" in page
    assert "mesh contact" not in page
    episode = json.loads(Path("info.json").read_text())["episodes"][0]
    assert episode["flat_area_final"] is episode["contact_final_true"] is None
    done("stats", "real.h5", "--json", "stats.json")
    stats = json.loads(Path("stats.json").read_text())
    assert stats["flat_area_final"] == [None, None]
    assert "states" not in stats["columns"]
    done("export", "real.h5", "--out", "tables", "--format", "csv")
    assert "imported 2 episodes" in done("import", "real.h5", "--out", "back.h5")


def test_validate_finds_nothing_in_a_sound_file(done):
    assert done("validate", "hanger.h5").startswith("valid")


def test_validate_prints_every_violation_with_its_path_and_exits_2(run):
    with h5py.File("hanger.h5", "r+") as file:
        del file["data/demo_1/obs/word"]
        file["data/demo_2"].attrs["seed"] = "seven"
    status, out, err = run("validate", "hanger.h5", "--json", "v.json")
    assert status == 2
    assert "/data/demo_1/obs/word: " in out
    assert "/data/demo_2@seed: " in out
    assert err.count("\n") == 1
    report = json.loads(Path("v.json").read_text())
    assert not report["valid"]
    assert len(report["violations"]) == len(out.splitlines()) >= 2


def test_stats_are_numpys(done):
    page = done("stats", "hanger.h5", "--json", "stats.json")
    report = json.loads(Path("stats.json").read_text())["columns"]
    with open_session("hanger.h5") as session:
        rows = session.arrays(["action_m", "obs/contact_portion"])
    for key in ("action_m", "obs/contact_portion"):
        np.testing.assert_allclose(report[key]["mean"], rows[key].mean(axis=0), rtol=1e-12, atol=1e-15)
        np.testing.assert_allclose(report[key]["std"], rows[key].std(axis=0), rtol=1e-9)
        assert report[key]["min"] == rows[key].min(axis=0).tolist()
        assert report[key]["count"] == 310
    assert "contact_portion" in page
    assert len(page.splitlines()) < 60


def test_split_and_merge_conserve(done):
    done("split", "hanger.h5", "--out", "parts", "--share", "a=3", "--share", "b=1", "--seed", "4")
    a, b = _seeds("parts/a.h5"), _seeds("parts/b.h5")
    assert (len(a), len(b)) == (3, 1)
    assert sorted(a + b) == [0, 1, 2, 3]
    done("merge", "parts/a.h5", "parts/b.h5", "hanger.h5", "--out", "all.h5")
    assert sorted(_seeds("all.h5")) == [0, 1, 2, 3]  # the same recordings are taken once
    done("merge", "all.h5", "more.h5", "--out", "five.h5")
    assert sorted(_seeds("five.h5")) == [0, 1, 2, 3, 9]


def test_split_has_a_usual_share(done):
    assert "parts/train.h5" in done("split", "hanger.h5", "--out", "parts")
    assert sorted(_seeds("parts/train.h5") + _seeds("parts/valid.h5")) == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("tests", "seeds"),
    [
        (("--outcome", "success"), [0, 2, 3]),
        (("--outcome", "failure"), [1]),
        (("--source", "gamepad"), [2, 3]),
        (("--cloth", "towel"), [0, 1, 2, 3]),
        (("--max-steps", "60"), [0, 3]),
        (("--min-steps", "61", "--source", "scripted"), [1]),
        (("--min-contact", "0.93"), [0, 3]),
        (("--max-contact", "0.93"), [1, 2]),
    ],
    ids=lambda value: " ".join(map(str, value)),
)
def test_filter_keeps_what_passes_every_test(tests, seeds, done):
    done("filter", "hanger.h5", "--out", "f.h5", *tests)
    assert _seeds("f.h5") == seeds


def test_trim_cuts_one_episode(done):
    assert "demo_1 with 20 of 95 steps, partial" in done(
        "trim", "hanger.h5", "--episode", "1", "--start", "10", "--stop", "30", "--out", "t.h5"
    )
    with open_session("t.h5") as cut, open_session("hanger.h5") as whole:
        assert [len(episode.steps) for episode in cut] == [60, 20, 95, 60]
        assert cut["demo_1"].first_step == 10
        np.testing.assert_array_equal(cut["demo_1"].steps[0].action, whole["demo_1"].steps[10].action)
    assert "60 of 95 steps, success" in done("trim", "hanger.h5", "--episode", "2", "--start", "35", "--out", "u.h5")


def test_repair_makes_a_sound_file_of_a_sick_one(run, done):
    with h5py.File("hanger.h5", "r+") as file:
        del file["data/demo_1/obs/word"]
    status, out, err = run("repair", "hanger.h5", "--out", "r.h5")
    assert status == 1
    assert "lost /data/demo_1" in out
    assert "r.h5" in err
    assert _seeds("r.h5") == [0, 2, 3]
    done("validate", "r.h5")
    assert "wrote 3 episodes" in done("repair", "r.h5")


FORMS = [("robomimic", "rm.hdf5"), ("csv", "tables"), ("lerobot", "lr"), ("minari", "mn"), ("rrd", "rr")]


@pytest.mark.parametrize(("form", "path"), FORMS)
def test_export_and_back(form, path, done):
    pytest.importorskip({"lerobot": "pyarrow", "minari": "minari", "rrd": "rerun"}.get(form, "h5py"))
    assert "exported 3 episodes" in done("export", "hanger.h5", "--out", path, "--format", form, "--outcome", "success")
    if form == "robomimic":
        assert "imported 3 episodes, copied bit by bit" in done("import", path, "--out", "back.h5")
        assert _seeds("back.h5") == [0, 2, 3]
    else:
        assert any(Path(path).iterdir())
    again = done("export", "hanger.h5", "--out", path, "--format", form, "--force")
    assert "exported 4 episodes" in again


def test_a_folder_is_not_named_like_a_file(run):
    for form, path in (("rrd", "demo.rrd"), ("csv", "steps.csv"), ("minari", "data.hdf5")):
        status, _, err = run("export", "hanger.h5", "--out", path, "--format", form)
        assert (status, Path(path).exists()) == (2, False)
        assert f"{path} is not a folder" in err


def test_a_lerobot_export_says_what_was_asked(done):
    pytest.importorskip("pyarrow")
    done("export", "hanger.h5", "--out", "lr", "--format", "lerobot", "--trim-idle", "--license", "cc0-1.0")
    card = Path("lr/README.md").read_text()
    assert 'license: "cc0-1.0"' in card
    assert "Lay the towel flat on the table with the hanger." in card
    done("export", "hanger.h5", "--out", "lr", "--format", "lerobot", "--task-text", "Spread it out.", "--force")
    assert "| task texts | Spread it out. |" in Path("lr/README.md").read_text()


def test_a_film_has_a_frame_for_each_observation(done):
    assert "6 frames" in done("video", "pickers.h5", "--episode", "0", "--out", "film.webm")
    assert count_frames(Path("film.webm")) == 6
    capture = cv2.VideoCapture("film.webm")
    frames = [capture.read()[1] for _ in range(6)]
    capture.release()
    assert frames[0].shape == (480, 640, 3)
    # The cloth, which is blue, slides to the right of the picture; the table stays where it is.
    columns = [np.flatnonzero((f[..., 0] > 100) & (f[..., 2] < 90)) % 640 for f in frames]
    assert np.mean(columns[-1]) > np.mean(columns[0]) + 10
    assert np.abs(frames[0][300:, 600:].astype(int) - frames[-1][300:, 600:]).mean() < 3


@pytest.mark.parametrize("arguments", [("hanger.h5",), ("hanger.h5", "--episode", "2"), ("pickers.h5",)], ids=" ".join)
def test_a_plot_is_a_picture(arguments, done):
    done("plot", *arguments, "--out", "plot.png")
    picture = cv2.imread("plot.png")
    assert picture.shape[0] > 800
    assert picture.shape[1] > 1200
    assert len(np.unique(picture[::7, ::7].reshape(-1, 3), axis=0)) > 20


# What they refuse


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_every_command(command, run):
    status, out, err = run(command, "--help")
    assert (status, err) == (0, "")
    assert f"Usage: layflat data {command}" in out


NEEDS = {
    "split": ("--out", "out"), "filter": ("--out", "out.h5"), "merge": ("--out", "out.h5"),
    "trim": ("--episode", "0", "--out", "out.h5"), "repair": ("--out", "out.h5"), "export": ("--out", "out.h5"),
    "import": ("--out", "out.h5"), "video": ("--episode", "0", "--out", "out.webm"), "plot": ("--out", "out.png"),
}  # fmt: skip


@pytest.mark.parametrize("name", ["missing.h5", "text.h5", "short.h5", "."])
@pytest.mark.parametrize("command", COMMANDS)
def test_a_file_that_is_no_session(command, name, run, folder):
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    status, _, err = run(command, name, *NEEDS.get(command, ()))
    assert status == 2, err
    sentences = [line for line in err.splitlines() if not line.startswith("[")]
    assert len(sentences) == 1
    assert sentences[0].startswith("layflat: ")
    assert name in sentences[0]
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


WRONG = {
    ("trim", "hanger.h5", "--episode", "7", "--out", "o.h5"): "demo_7",
    ("trim", "hanger.h5", "--episode", "-1", "--out", "o.h5"): "--episode is -1",
    ("trim", "hanger.h5", "--episode", "0", "--start", "9", "--stop", "3", "--out", "o.h5"): "9 to 3",
    ("video", "pickers.h5", "--episode", "0", "--out", "film.mp4"): ".webm",
    ("video", "pickers.h5", "--episode", "4", "--out", "film.webm"): "demo_4",
    ("plot", "hanger.h5", "--out", "plot.jpg"): ".png",
    ("plot", "hanger.h5", "--episode", "11", "--out", "plot.png"): "demo_11",
    ("split", "hanger.h5", "--out", "o", "--share", "train"): "NAME|name and a number",
    ("split", "hanger.h5", "--out", "o", "--share", "../x=1"): "name and a number",
    ("split", "hanger.h5", "--out", "o", "--share", "a=0"): "above 0",
    ("split", "hanger.h5", "--out", "o", "--share", "a=1", "--share", "a=2"): "twice",
    ("split", "more.h5", "--out", "o"): "too few",
    ("filter", "hanger.h5", "--out", "o.h5", "--outcome", "partial"): "partial",
    ("filter", "hanger.h5", "--out", "o.h5", "--source", "somebody"): "none of the 4",
    ("filter", "hanger.h5", "--out", "o.h5", "--min-steps", "9", "--max-steps", "3"): "nothing can pass",
    ("filter", "hanger.h5", "--out", "o.h5", "--min-steps", "-2"): "--min-steps is -2",
    ("merge", "hanger.h5", "pickers.h5", "--out", "o.h5"): "robot",
    ("merge", "hanger.h5", "more.h5", "--out", "hanger.h5", "--force"): "one of the files",
    ("export", "hanger.h5", "--out", "o", "--format", "xml"): "xml",
    ("export", "hanger.h5", "--out", "o.hdf5", "--valid-share", "1"): "share",
    ("export", "hanger.h5", "--out", "o", "--format", "csv", "--no-images"): "--no-images",
    ("export", "hanger.h5", "--out", "o", "--outcome", "partial"): "partial",
    ("export", "hanger.h5", "--out", ".", "--format", "lerobot", "--force"): "not a LeRobot data set",
    ("export", "hanger.h5", "--out", "o", "--format", "csv", "--depth"): "--depth is for lerobot",
    ("export", "hanger.h5", "--out", "o", "--license", "mit"): "--license is for lerobot",
    ("export", "hanger.h5", "hanger.h5", "--out", "o"): "one session, got 2; merge them first",
    ("export", "hanger.h5", "--out", "o", "--format", "lerobot", "--depth", "--no-images"): "remove --no-images",
    ("export", "hanger.h5", "--out", "o", "--format", "lerobot", "--task-text", " "): "--task-text is empty",
    ("export", "hanger.h5", *("--out", "o", "--format", "lerobot", "--task-text", "a", "--task-text", "b")): "got 2",
}


@pytest.mark.parametrize("arguments", WRONG, ids=" ".join)
def test_wrong_calls_are_one_sentence_and_leave_nothing(arguments, run, folder):
    before = sorted(path for path in folder.rglob("*") if path.is_file())
    status, out, err = run(*arguments)
    assert (status, out) == (2, "")
    assert len([line for line in err.splitlines() if not line.startswith("[")]) == 1
    assert any(text in err for text in WRONG[arguments].split("|"))
    assert sorted(path for path in folder.rglob("*") if path.is_file()) == before


@pytest.mark.parametrize("command", sorted(NEEDS))
def test_outputs_are_not_replaced_unasked(command, run, folder):
    source = "pickers.h5" if command == "video" else "hanger.h5"
    arguments = list(NEEDS[command])
    suffix = Path(arguments[-1]).suffix
    taken = folder / f"taken{suffix}"
    if command == "split":
        taken = folder / "train.h5"
    taken.write_text("precious")
    arguments[-1] = str(folder if command == "split" else taken)
    status, _, err = run(command, source, *arguments)
    assert status == 2
    assert "--force" in err
    assert taken.read_text() == "precious"


def test_help_imports_nothing_heavy():
    program = (
        "import sys\nfrom layflat.app.cli.main import main\ntry:\n    main(['data', '--help'])\n"
        "except SystemExit:\n    pass\n"
        "print([m for m in ('numpy', 'h5py', 'pyarrow', 'matplotlib') if m in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "[]"
