"""Bad input to record, train, place and bench: one sentence that names it, status 2, and nothing written or changed."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from layflat.app.benchmarks.measure import random_model
from layflat.app.cli import main
from layflat.data.session.recorder import SessionRecorder
from layflat.policy import model_io
from layflat.policy.registry import WRAPPERS
from layflat.sim.cloth.registry import CLOTHS
from layflat.sim.disturbances.presets import DISTURBANCES
from layflat.sim.robots.registry import robot_spec

Refused = Callable[..., str]


@pytest.fixture
def things(tmp_path, make_episode) -> Path:
    """A folder with good and bad sessions and models in it."""
    for robot in ("hanger", "pickers"):
        with SessionRecorder(tmp_path / f"{robot}.h5", robot=robot_spec(robot), cloth="towel") as recorder:
            recorder.save(make_episode(robot=robot, disturbed=False))
    with SessionRecorder(tmp_path / "failures.h5", robot=robot_spec("hanger"), cloth="towel") as recorder:
        recorder.save(make_episode(outcome="failure", disturbed=False))
    model_io.save(random_model("hanger", 20), tmp_path / "hanger.npz")
    for name in ("hanger.h5", "hanger.npz"):
        whole = (tmp_path / name).read_bytes()
        (tmp_path / f"short-{name}").write_bytes(whole[: len(whole) * 2 // 3])
        (tmp_path / f"empty-{name}").write_bytes(b"")
        (tmp_path / f"text-{name}").write_text("dear diary")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["pressure"] = np.arange(5)
    np.savez(tmp_path / "other.npz", weights=np.arange(5))
    np.savez(tmp_path / "pickle.npz", header=np.array([{"a": 1}], dtype=object), allow_pickle=True)
    _tamper(tmp_path / "hanger.npz", tmp_path / "tampered.npz")
    (tmp_path / "taken.json").write_text("precious")
    (tmp_path / "taken.npz").write_text("precious")
    return tmp_path


def _tamper(source: Path, target: Path) -> None:
    with np.load(source) as archive:
        arrays = {name: archive[name] for name in archive.files}
    arrays["alpha"] = arrays["alpha"] + 0.001
    np.savez(target, **arrays)


def _contents(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def refused(things, capsys, monkeypatch) -> Refused:
    """Runs a command in the folder of ``things``; returns its sentence after what must hold of every refusal."""
    monkeypatch.chdir(things)

    def run(*arguments: str) -> str:
        before = _contents(things)
        with pytest.raises(SystemExit) as stop:
            main.main(arguments)
        out, err = capsys.readouterr()
        assert stop.value.code == 2, err
        assert out == ""
        assert "Traceback" not in err
        sentences = [line for line in err.splitlines() if not line.startswith("[")]  # plain progress is [  0 %] ...
        assert len(sentences) == 1
        assert sentences[0].startswith("layflat: ")
        assert _contents(things) == before
        return sentences[0]

    return run


@pytest.mark.parametrize(
    "name", ["missing.h5", "short-hanger.h5", "empty-hanger.h5", "text-hanger.h5", "other.h5", "."]
)
def test_train_wants_a_whole_session(name, refused):
    assert name in refused("train", name, "m.npz")


def test_train_wants_successful_demonstrations(refused):
    assert "none of the 1 demonstrations" in refused("train", "failures.h5", "m.npz")


def test_train_writes_a_new_npz_file(refused):
    assert "--force" in refused("train", "hanger.h5", "taken.npz")
    assert ".npz" in refused("train", "hanger.h5", "m.pkl")


@pytest.mark.parametrize("path", ["hanger.h5/m", "/proc/nowhere/m", "/dev/null/m"])
@pytest.mark.parametrize(
    "command",
    [
        ("train", "hanger.h5", "{}.npz"),
        ("record", "{}.h5"),
        ("place", "hanger.npz", "--json", "{}.json"),
        ("place", "hanger.npz", "--record", "{}.h5"),
        ("place", "hanger.npz", "--video", "{}.webm"),
        ("flatten", "--json", "{}.json"),
        ("flatten", "--strip", "{}.png"),
        ("flatten", "--video", "{}.webm"),
        ("bench", "--json", "{}.json"),
    ],
    ids=lambda command: " ".join(command),
)
def test_outputs_that_cannot_be_written_are_found_before_the_work(command, path, refused):
    assert "cannot be written" in refused(*(word.format(path) for word in command))


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("missing.npz", "does not exist"),
        ("short-hanger.npz", "part of one"),
        ("empty-hanger.npz", "not a model"),
        ("text-hanger.npz", "not a model"),
        ("other.npz", "not a usable model"),
        ("pickle.npz", "not a usable model"),
        ("tampered.npz", "checksum"),
        ("hanger.h5", "not a model"),
        (".", "is not a file"),
    ],
)
def test_place_wants_a_whole_model(name, hint, refused):
    sentence = refused("place", name)
    assert name in sentence
    assert hint in sentence


def test_a_session_of_the_other_robot_takes_no_episodes(refused):
    sentence = refused("place", "hanger.npz", "--record", "pickers.h5")
    assert all(word in sentence for word in ("pickers.h5", "robot pickers", "not hanger"))
    assert "robot pickers" in refused("record", "pickers.h5", "--robot", "hanger")
    assert "cloth towel" in refused("record", "hanger.h5", "--cloth", "napkin")


@pytest.mark.parametrize("name", ["text-hanger.h5", "other.h5", "short-hanger.h5"])
def test_record_does_not_touch_a_file_that_is_no_session(name, refused):
    assert name in refused("record", name)


def test_record_never_replaces(refused):
    assert "appends" in refused("record", "hanger.h5", "--force")


@pytest.mark.parametrize("command", [("record", "x.h5"), ("place", "hanger.npz"), ("flatten",)], ids=" ".join)
def test_an_unknown_cloth_gets_the_list(command, refused):
    sentence = refused(*command, "--cloth", "silk")
    assert "'silk'" in sentence
    assert all(name in sentence for name in CLOTHS)


def test_an_unknown_disturbance_gets_the_list(refused):
    sentence = refused("place", "hanger.npz", "--disturb", "earthquake")
    assert "'earthquake'" in sentence
    assert all(name in sentence for name in DISTURBANCES)


def test_an_unknown_wrapper_gets_the_list(refused):
    sentence = refused("place", "hanger.npz", "--with", "luck")
    assert "'luck'" in sentence
    assert all(name in sentence for name in WRAPPERS)


def test_what_exists_stays_without_force(refused):
    assert "--force" in refused("place", "hanger.npz", "--json", "taken.json")
    assert "--force" in refused("bench", "--json", "taken.json")
    assert "--force" in refused("flatten", "--json", "taken.json")
    assert ".webm" in refused("place", "hanger.npz", "--video", "film.mp4")


@pytest.mark.parametrize("name", ["missing.h5", "short-hanger.h5", "text-hanger.h5", "other.h5", "."])
@pytest.mark.parametrize("mode", ["state", "action"])
def test_replay_wants_a_whole_session(mode, name, refused):
    assert name in refused("replay", name, "--episode", "0", "--mode", mode)


def test_replay_says_what_it_cannot_show(refused):
    assert "demo_3" in refused("replay", "hanger.h5", "--episode", "3")
    assert "--force" in refused("replay", "hanger.h5", "--episode", "0", "--json", "taken.json")
    assert ".webm" in refused("replay", "hanger.h5", "--episode", "0", "--video", "film.mp4")
    assert "nodes of shape (4, 3)" in refused("replay", "hanger.h5", "--episode", "0", "--video", "film.webm")


def test_the_program_itself_exits_so(things):
    done = subprocess.run(
        [sys.executable, "-m", "layflat.app.cli.main", "train", str(things / "short-hanger.h5"), str(things / "m.npz")],
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert not (things / "m.npz").exists()


SIMULATING = [
    ("record", "new.h5"),
    ("place", "scripted"),
    ("evaluate", "scripted", "--robot", "hanger", "--out", "e"),
    ("disturb", "scripted", "--robot", "hanger", "--out", "e"),
    ("flatten",),
    ("replay", "hanger.h5", "--episode", "0", "--mode", "action"),
    ("demo", "--out", "d"),
    ("app", "--no-open"),
]


@pytest.mark.parametrize("command", SIMULATING, ids=lambda command: command[0])
@pytest.mark.parametrize(
    ("setting", "hint"),
    [
        ("table_frition=1", "did you mean table_friction?"),
        ("table_friction=9", "table_friction is 9.0; it must be a number between 0 and 5"),
        ("table_friction", "must be KEY=VALUE"),
    ],
)
def test_a_condition_that_is_wrong_is_refused_wherever_one_is_taken(command, setting, hint, refused):
    assert hint in refused(*command, "--set", setting)


@pytest.mark.parametrize("command", [SIMULATING[0], SIMULATING[2], SIMULATING[3]], ids=lambda command: command[0])
def test_a_variation_that_is_wrong_is_refused(command, refused, things):
    (things / "reversed.toml").write_text("schema = 1\n[draw]\nmass_factor = { uniform = [2.0, 1.0] }\n")
    (things / "torn.toml").write_text("schema = 1\n[draw")
    assert "give one of all, camera, cloths" in refused(*command, "--vary", "clothes")
    assert "give the lower value first" in refused(*command, "--vary", "reversed.toml")
    assert "torn.toml is not TOML" in refused(*command, "--vary", "torn.toml")
    assert "leave one out" in refused(*command, "--vary", "light", "--set", "light_strength=1")


def test_state_replay_takes_no_condition(refused):
    assert "--mode action" in refused("replay", "hanger.h5", "--episode", "0", "--set", "mass_factor=2")
