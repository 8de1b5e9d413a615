"""Station files: every wrong one is one sentence."""

from pathlib import Path

import pytest

from layflat.app.hardware.station_config import read_station, update_station
from layflat.app.support.errors import UsageError

WHOLE = """schema = 1
name = "lab"          # ours
cloth = "napkin"

[robot]
host = "10.0.0.2"
force_n = 12

[camera]
serial = "0123"
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "station.toml"
    path.write_text(text)
    return path


def test_reads_values_and_defaults(tmp_path: Path) -> None:
    station = read_station(written(tmp_path, WHOLE))
    assert (station.cloth_spec().name, station.robot.force_n, station.camera.fps) == ("napkin", 12.0, 30)
    assert station.robot.stiffness_n_m == 400.0


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("schema = 1", "schema = 2", "schema must be 1"),
        ("force_n = 12", "forc_n = 12", "unknown key robot.forc_n; did you mean force_n?"),
        ("force_n = 12", 'force_n = "12"', "robot.force_n is '12'; it must be a finite number"),
        ("force_n = 12", "force_n = nan", "robot.force_n is nan; it must be a finite number"),
        ("force_n = 12", "force_n = 900", "robot.force_n is 900; it must be from 2 to 60"),
        ("force_n = 12", "base_m = [0, 1]", "robot.base_m is [0, 1]; it must be a list of 3 numbers"),
        ("force_n = 12", "workspace_low_m = [1.0, 0.0, 0.0]", "must be below workspace_high_m"),
        ('host = "10.0.0.2"', "", "robot.host is missing"),
        ('serial = "0123"', 'serial = "0123"\nbag = "x.bag"', "a serial number and a bag"),
        ("[robot]", "[robot", "is not TOML"),
    ],
)
def test_a_wrong_file_is_one_sentence(tmp_path: Path, old: str, new: str, says: str) -> None:
    path = written(tmp_path, WHOLE.replace(old, new))
    with pytest.raises(UsageError) as caught:
        read_station(path)
    assert says in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_unknown_cloth_is_said(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="unknown cloth 'silky'"):
        read_station(written(tmp_path, WHOLE.replace("napkin", "silky"))).cloth_spec()


def test_an_update_keeps_comments_and_all_else(tmp_path: Path) -> None:
    pytest.importorskip("tomlkit")
    path = written(tmp_path, WHOLE)
    update_station(path, "camera", {"flat_pixels": 1234, "position_m": [0.1, -0.7, 0.9]})
    assert "# ours" in path.read_text()
    station = read_station(path)
    assert (station.camera.flat_pixels, station.camera.serial) == (1234, "0123")
    assert station.camera.position_m == (0.1, -0.7, 0.9)
