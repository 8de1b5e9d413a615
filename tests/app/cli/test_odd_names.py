"""Names that are not UTF-8, wherever a path goes; and text that the terminal cannot encode."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

import layflat
from layflat.app.cli import main
from layflat.app.media.video import count_frames, write_video
from layflat.app.support.metrics import write_json
from layflat.data.provenance import OPERATOR, capture_provenance
from layflat.data.session.reader import open_session
from layflat.data.tools.validate import validate
from layflat.data.types import Provenance
from layflat.tests.factories import write_session

ODD = os.fsdecode(b"caf\xe9")
OPENS_A_PATH = re.compile(r"cv2\.(imread|imwrite|imreadmulti|VideoCapture|VideoWriter)\(([^)]*)")
ROOT = Path(layflat.__file__).parent


@pytest.fixture
def odd(tmp_path, monkeypatch, make_episode, lying) -> Path:
    """The current folder, which holds a session; none of the three names is UTF-8."""
    folder = tmp_path / ODD
    folder.mkdir()
    monkeypatch.chdir(folder)
    episodes = [lying(make_episode(seed=seed, disturbed=False, outcome="success"), n_steps=40) for seed in range(4)]
    write_session(folder / f"{ODD}.h5", episodes)
    return folder


@pytest.fixture
def run(capsys) -> Callable[..., str]:
    def call(*arguments: str) -> str:
        with pytest.raises(SystemExit) as stop:
            main.main(arguments)
        out, err = capsys.readouterr()
        assert stop.value.code == 0, err
        return out

    return call


@pytest.mark.parametrize(
    "command",
    [
        "data info {0}.h5 --json {0}.json",
        "data validate {0}.h5 --json {0}.json",
        "data stats {0}.h5 --json {0}.json",
        "data split {0}.h5 --out {0}",
        "data filter {0}.h5 --out {0}/new.h5 --outcome success",
        "data merge {0}.h5 --out {0}/new.h5",
        "data trim {0}.h5 --episode 0 --out {0}/new.h5 --stop 20",
        "data repair {0}.h5 --out {0}/new.h5",
        "data export {0}.h5 --out {0}.hdf5",
        "data export {0}.h5 --out {0} --format csv",
        "data plot {0}.h5 --out {0}.png",
        "data video {0}.h5 --episode 3 --out {0}.webm",
        "train {0}.h5 {0}.npz --policy nearest",
        "replay {0}.h5 --episode 3 --json {0}.json --video {0}.webm",
    ],
)
def test_every_command_takes_and_prints_such_names(odd, run, command):
    run(*command.format(ODD).split())
    made = [path for path in odd.rglob("*") if path.is_file() and path.name != f"{ODD}.h5"]
    assert made
    for path in made:
        if path.suffix == ".json":
            assert json.dumps(json.loads(path.read_bytes()), ensure_ascii=False).encode("utf-8")
        if path.suffix == ".webm":
            assert count_frames(path.rename(path.with_name("ascii.webm"))) > 1


def test_opencv_is_given_no_path_of_the_users():
    """Its binding crashes on text that is not UTF-8."""
    calls = {
        f"{path.relative_to(ROOT)}: {found[0]}"
        for folder in ("app", "data", "perception", "policy", "sim")
        for path in (ROOT / folder).rglob("*.py")
        for found in OPENS_A_PATH.finditer(path.read_text(encoding="utf-8"))
        if not found[2].startswith("name")  # of ascii_folder
    }
    assert not calls


def test_a_folder_for_temporary_files_with_such_a_name(odd, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(odd))
    env = layflat.make_env(robot="hanger", cloth="towel")
    env.reset(0)
    env.close()


def test_a_video_replaces_one_only_when_it_is_whole(odd):
    path = odd / f"{ODD}.webm"
    frames = [np.full((48, 64, 3), shade, np.uint8) for shade in (0, 90, 200)]
    assert write_video(path, frames) == 3
    whole = path.read_bytes()

    def failing():
        yield frames[0]
        raise RuntimeError("gone")

    with pytest.raises(RuntimeError, match="gone"):
        write_video(path, failing())
    assert path.read_bytes() == whole
    assert sorted(file.name for file in odd.iterdir()) == sorted([path.name, f"{ODD}.h5"])


def test_an_operator_in_another_encoding(tmp_path, monkeypatch, run, make_episode):
    monkeypatch.setenv(OPERATOR, os.fsdecode(b"J\xf6rg"))
    monkeypatch.setattr("sys.argv", ["layflat", ODD])
    episode = make_episode(provenance=capture_provenance())
    write_session(tmp_path / "s.h5", [episode])
    assert r"J\udcf6rg" in run("data", "info", str(tmp_path / "s.h5"))
    with open_session(tmp_path / "s.h5") as session:
        assert session.episode("demo_0").provenance.command.encode("utf-8")


def test_a_session_with_such_an_operator_that_is_stored_as_it_was(tmp_path, run, make_episode):
    provenance = Provenance()
    object.__setattr__(provenance, "operator", os.fsdecode(b"J\xf6rg"))  # As it once was written.
    write_session(tmp_path / "s.h5", [make_episode(provenance=provenance)])
    assert not validate(tmp_path / "s.h5")
    assert r"J\udcf6rg" in run("data", "info", str(tmp_path / "s.h5"))
    with open_session(tmp_path / "s.h5") as session:
        assert session.episode("demo_0").provenance.operator == r"J\udcf6rg"


def test_json_is_utf8_whatever_is_in_it(tmp_path):
    write_json(tmp_path / "x.json", {"file": Path(f"{ODD}-\u00e9-\U0001f9fa")})
    text = (tmp_path / "x.json").read_bytes().decode("utf-8")
    assert "\\ud" not in text.replace("\\\\", "")
    assert json.loads(text)["file"] == r"caf\udce9-" + "\u00e9-\U0001f9fa"


@pytest.mark.parametrize("encoding", ["utf-8:strict", "ascii", "ascii:strict"])
def test_output_that_the_terminal_cannot_encode(odd, encoding):
    done = subprocess.run(
        [sys.executable, "-m", "layflat.app.cli.main", "data", "info", f"{ODD}.h5"],
        capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": encoding},
    )
    assert done.returncode == 0, done.stderr
    assert rb"caf\udce9.h5: 4 episodes" in done.stdout


@pytest.mark.parametrize("picture", ["rgb", "depth"])
def test_a_picture_that_cannot_be_read_is_named(odd, capsys, picture):
    _, png = cv2.imencode(".png", np.zeros((8, 8, 3), np.uint8))
    (odd / f"{ODD}-rgb.png").write_bytes(png.tobytes() if picture == "depth" else b"dear diary")
    (odd / f"{ODD}-depth.png").write_bytes(b"dear diary")
    with pytest.raises(SystemExit) as stop:
        main.main(["word", f"{ODD}-rgb.png", f"{ODD}-depth.png"])
    out, err = capsys.readouterr()
    assert (stop.value.code, out) == (2, "")
    assert f"-{picture}.png" in err
