"""`layflat place`, `flatten` and `record` with episodes that end, crash or are interrupted; without physics."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from layflat.app.benchmarks.measure import random_model
from layflat.app.commands.flatten import FlattenConfig, flatten
from layflat.app.commands.place import PlaceConfig, place
from layflat.app.commands.record import record
from layflat.app.support.errors import LayflatError
from layflat.app.support.metrics import COLUMNS
from layflat.app.workers.record_config import RecordConfig
from layflat.data import open_session, validate
from layflat.data.errors import DataError
from layflat.policy import model_io
from layflat.tests.app.fake_episodes import PLACING, FakeEpisodes, Fault

SEED = 7
STATUS = "its process ended with status 7"


def episodes(robot: str, cloth: str, label: str, *faults: Fault | None, marks: Path = Path()) -> FakeEpisodes:
    """Return episodes of SEED, SEED + 1, ... with these faults, which come when three steps are in the journal."""
    keys = [(f"{robot} {cloth} {label} {SEED + k}", PLACING) for k in range(len(faults))]
    return FakeEpisodes({key: (fault,) for key, fault in zip(keys, faults, strict=True)}, marks=marks)


@pytest.fixture
def placed(tmp_path):
    """``placed(*faults, record=False)``: place an episode for each fault or None."""
    model_io.save(random_model("hanger", 20), tmp_path / "m.npz")

    def call(*faults, recorded=False) -> None:
        config = PlaceConfig(
            policy=str(tmp_path / "m.npz"), episodes=len(faults), seed=SEED, json=tmp_path / "rows.json",
            record=tmp_path / "s.h5" if recorded else None,
        )  # fmt: skip
        make = episodes("hanger", "towel", random_model("hanger", 20).policy, *faults)
        place(config, workers=1, force=False, make=make)

    return call


@pytest.fixture
def flattened(tmp_path):
    def call(*faults, controller="stretch-right", **pictures) -> None:
        config = FlattenConfig(
            controller=controller, cloth="napkin", episodes=len(faults), seed=SEED, json=tmp_path / "rows.json",
            **pictures,
        )  # fmt: skip
        flatten(config, workers=1, force=False, make=episodes("pickers", "napkin", controller, *faults))

    return call


def rows_in(folder: Path) -> dict:
    return json.loads((folder / "rows.json").read_text())


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_crashed_episode_has_a_row_with_its_reason(placed, tmp_path):
    with pytest.raises(LayflatError, match=rf"1 of 3 episodes were lost: {STATUS}; the others are kept"):
        placed(None, "exit", None)
    content = rows_in(tmp_path)
    assert (content["schema"], content["lost"]) == (1, 1)
    assert content["provenance"]["versions"]
    assert [(row["seed"], row["crashed"]) for row in content["episodes"]] == [(7, False), (8, True), (9, False)]
    crashed = content["episodes"][1]
    assert [key for key in crashed if key != "reason"] == list(COLUMNS) == list(content["episodes"][0])
    assert (crashed["reason"], crashed["stopped_by"], crashed["contact_final"]) == (STATUS, "crashed", None)
    assert crashed["disturbance"] == "none"
    assert crashed["policy"] == content["episodes"][0]["policy"]


def test_a_crashed_episode_is_recorded_as_partial(placed, tmp_path):
    with pytest.raises(LayflatError, match="1 of 2"):
        placed("kill", None, recorded=True)
    assert validate(tmp_path / "s.h5") == ()
    with open_session(tmp_path / "s.h5") as session:
        found = [(info.seed, info.outcome, info.stopped_by, info.n_steps) for info in session.infos().values()]
        assert session.names == ("demo_0", "demo_1")
    assert found == [(7, "partial", "crashed", 2), (8, "success", "converged", 3)]
    assert names_in(tmp_path) == ["m.npz", "rows.json", "s.h5"]


def test_ctrl_c_keeps_the_finished_episodes_and_nothing_of_the_running_one(placed, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        placed(None, "interrupt", None, recorded=True)
    assert [row["seed"] for row in rows_in(tmp_path)["episodes"]] == [7]
    with open_session(tmp_path / "s.h5") as session:
        assert [info.seed for info in session.infos().values()] == [7]
    assert names_in(tmp_path) == ["m.npz", "rows.json", "s.h5"]


def test_ctrl_c_reports_the_episodes_that_were_lost_before_it(placed, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        placed("exit", "interrupt")
    content = rows_in(tmp_path)
    assert [(row["seed"], row["crashed"]) for row in content["episodes"]] == [(7, True)]
    assert content["lost"] == 1


def test_ctrl_c_before_anything_is_finished_writes_nothing(placed, tmp_path, capsys):
    with pytest.raises(KeyboardInterrupt):
        placed("interrupt")
    assert names_in(tmp_path) == ["m.npz"]
    assert capsys.readouterr().out == ""


def test_flatten_writes_the_shared_rows_and_their_mean(flattened, tmp_path, capsys):
    flattened(None, None, None)
    content = rows_in(tmp_path)
    rows = content["episodes"]
    assert content["schema"] == 1
    assert [row["seed"] for row in rows] == [7, 8, 9] == [start["seed"] for start in content["starts"]]
    assert all(tuple(row) == COLUMNS and row["policy"] == "stretch-right" for row in rows)
    assert {(row["robot"], row["cloth"], row["task"]) for row in rows} == {("pickers", "napkin", "smooth")}
    assert content["summary"]["n"] == 3
    assert content["summary"]["contact_final"]["mean"] == pytest.approx(np.mean([row["contact_final"] for row in rows]))
    assert content["provenance"]["versions"]
    out = capsys.readouterr().out
    assert "mean" in out
    assert "mesh final" in out


def test_one_flattened_episode_has_no_interval(flattened, tmp_path):
    flattened(None)
    assert rows_in(tmp_path)["summary"]["contact_final"]["ci95"] == [None, None]


def test_flatten_reports_a_lost_episode_and_writes_the_others(flattened, tmp_path, capsys):
    with pytest.raises(LayflatError, match=f"1 of 3 episodes were lost: {STATUS}"):
        flattened(None, "exit", None)
    content = rows_in(tmp_path)
    assert [row["seed"] for row in content["episodes"]] == [7, 9]
    assert content["lost"] == [{"seed": 8, "reason": STATUS}]
    out, err = capsys.readouterr()
    assert "mean" in out
    assert f"seed 8: lost, {STATUS}" in err


def test_ctrl_c_while_flattening_keeps_the_finished_episodes_and_draws_nothing(flattened, tmp_path, capsys):
    with pytest.raises(KeyboardInterrupt):
        flattened(None, "exit", "interrupt", video=tmp_path / "run.webm", strip=tmp_path / "run.png")
    assert names_in(tmp_path) == ["rows.json"]
    content = rows_in(tmp_path)
    assert [row["seed"] for row in content["episodes"]] == [7]
    assert [lost["seed"] for lost in content["lost"]] == [8]
    assert "mesh final" in capsys.readouterr().out


def test_ctrl_c_before_an_episode_is_flat_writes_nothing(flattened, tmp_path, capsys):
    with pytest.raises(KeyboardInterrupt):
        flattened("exit", "interrupt", None)
    assert not names_in(tmp_path)
    assert capsys.readouterr().out == ""


def recorded(path: Path, *faults, workers=1, **settings) -> None:
    config = RecordConfig(path=path, episodes=len(faults), seed=SEED, **settings)
    make = episodes(config.robot, config.cloth, "scripted", *faults, marks=path.parent)
    record(config, force=False, workers=workers, make=make)


def test_record_prints_a_line_for_each_durable_episode(tmp_path, capsys):
    path = tmp_path / "s.h5"
    recorded(path, None, None, workers=2)
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [line[:5] for line in lines] == [["kept", f"demo_{k}", "success", "3", "steps"] for k in range(2)]
    recorded(path, None)
    assert "kept demo_2 success" in capsys.readouterr().out
    assert validate(path) == ()


def test_record_saves_the_rest_of_a_lost_episode_and_all_others(tmp_path, capsys):
    path = tmp_path / "s.h5"
    with pytest.raises(LayflatError, match=f"1 of 3 episodes were lost: {STATUS}; the others are kept"):
        recorded(path, None, "exit", None)
    assert [line.split()[1:3] for line in capsys.readouterr().out.splitlines()] == [
        ["demo_0", "success"], ["demo_1", "partial"], ["demo_2", "success"],
    ]  # fmt: skip
    assert validate(path) == ()


def test_a_full_disk_ends_a_recording_in_one_sentence_and_loses_nothing(tmp_path, capsys):
    path = tmp_path / "s.h5"
    with pytest.raises(Exception, match=r"s\.h5.* cannot be written: File too large") as caught:
        recorded(path, None, "disk", None)
    assert getattr(caught.value, "exit_status", None) == 1
    out = capsys.readouterr().out
    assert out.startswith("kept demo_0 success")
    with open_session(path) as session:
        assert [info.seed for info in session.infos().values() if info.outcome == "success"] == [7]
        assert len(session) == out.count("kept ")
    assert validate(path) == ()


def test_a_recording_of_another_task_is_a_session_of_that_task(tmp_path):
    path = tmp_path / "s.h5"
    recorded(path, None, robot="pickers", task="smooth")
    with open_session(path) as session:
        assert (session.task, session.robot.name) == ("smooth", "pickers")
    with pytest.raises(DataError, match="task smooth, not place"):
        recorded(path, None, robot="pickers")
