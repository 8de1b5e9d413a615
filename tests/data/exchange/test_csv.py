"""CSV exports hold the same bits as the session."""

from __future__ import annotations

import csv
import json

import pytest

from layflat.data import open_session
from layflat.data.columns import LEGEND
from layflat.data.errors import DataError
from layflat.data.exchange.csv_export import EPISODES_CSV, STEPS_CSV, export_csv
from layflat.tests.factories import ROBOT_SPECS, make_episode, write_session


@pytest.mark.parametrize("robot", ROBOT_SPECS)
def test_csv_reads_back_to_the_same_bits(robot, tmp_path):
    made = [make_episode(robot, n_steps=3 + i, seed=i, with_std=i % 2 == 0) for i in range(3)]
    with open_session(write_session(tmp_path / "s.h5", made)) as session:
        assert export_csv(session, tmp_path / "out") == 3 + 4 + 5
    legend = json.loads((tmp_path / "out" / LEGEND).read_text())["tables"]
    for table in (EPISODES_CSV, STEPS_CSV):
        with (tmp_path / "out" / table).open(newline="") as file:
            assert list(legend[table]) == next(csv.reader(file))
        for name, column in legend[table].items():
            assert column["is"]
            assert name.endswith(f"_{column['unit']}".lower()) == (column["unit"] not in ("", "1"))
    with (tmp_path / "out" / STEPS_CSV).open(newline="") as file:
        rows = list(csv.DictReader(file))
    with (tmp_path / "out" / EPISODES_CSV).open(newline="") as file:
        about = list(csv.DictReader(file))
    assert [row["episode"] for row in about] == ["demo_0", "demo_1", "demo_2"]
    assert [int(row["seed"]) for row in about] == [0, 1, 2]
    for number, episode in enumerate(made):
        own = [row for row in rows if row["episode"] == f"demo_{number}"]
        assert [int(row["step"]) for row in own] == list(range(len(episode.steps) + 1))
        assert float(about[number]["contact_final"]) == episode.contact()[-1]
        for row, seen, ground_truth in zip(own, episode.observations(), episode.ground_truths(), strict=True):
            corners = [float(row[f"corner{c}_{axis}_m"]) for c in (1, 2) for axis in "xyz"]
            assert corners == seen.corner_positions.ravel().tolist()
            assert [float(row["word_x"]), float(row["word_y"])] == seen.word.tolist()
            assert float(row["flat_area"]) == ground_truth.flat_area
        columns = [f"{name}_m" for name in robot.action_names]
        for row, step in zip(own, episode.steps, strict=False):
            assert [float(row[key]) for key in columns] == step.action.tolist()
            std = [row[f"std_{key}"] for key in columns]
            assert std == [""] * len(std) if step.action_std is None else list(map(float, std)) == [*step.action_std]
        assert all(own[-1][key] == "" for key in (*columns, "phase"))


def test_an_empty_csv_export_is_refused(tmp_path):
    with (
        open_session(write_session(tmp_path / "s.h5", [make_episode()])) as session,
        pytest.raises(DataError, match="nothing to export"),
    ):
        export_csv(session, tmp_path / "out", names=())
    assert not (tmp_path / "out").exists()
