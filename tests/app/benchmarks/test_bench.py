"""`layflat bench`: names and ratios of its rows, and short real runs."""

from __future__ import annotations

import json
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest

from layflat.app.benchmarks import (
    bench,
    measure,
    measure_batch,
    measure_data,
    measure_env,
    measure_perception,
    measure_solver_settings,
)
from layflat.app.benchmarks.rows import RTF, BenchmarkRow
from layflat.data.types import STEP_S
from layflat.perception.descriptors.word import AXIAL_CONFIG, THESIS_CONFIG
from layflat.sim.physics.bullet.reference_cloths import SITUATIONS, SOLVER_SETTINGS
from layflat.sim.robots.registry import THESIS_ROBOTS
from layflat.tests.app.fake_episodes import FakeEpisodes

PACKED = [f"{what} {name}" for what in ("pack", "size") for name in measure_data.COMPRESSIONS]
KEYS = ["name", "value", "unit", "baseline", "ratio"]
NAMES = {
    "physics": ("air", "air bare", "drag", "flat", "flat bare"),
    "seeing": ("flat", "drag", "capture", "perceive", "keep"),
    "perception": ("percept", "reference", "reference how", "how", "word", "hog"),
    "prediction": ("predict", "GPy"),
    "published cloths": tuple(
        f"{where} {who}" for where in SITUATIONS for who in (measure_solver_settings.OURS, *SOLVER_SETTINGS)
    ),
    "environment": ("reset", "hanging", "step", "image", "bare"),
    "environments": tuple(str(number) for number in measure_env.PROCESSES),
    "evaluation": tuple(str(workers) for workers in measure_batch.WORKERS),
    "recording": ("step", "hand over", "journal", "keep", "raw", "size", *PACKED),
    "opening": ("open", "read", "columns", "growth", "episodes"),
}
"""Samples of each measurement."""


def _samples(title: str, wall_s: float = 0.05) -> dict[str, np.ndarray]:
    return {name: np.array([wall_s, 2 * wall_s, 0.9 * wall_s]) for name in NAMES[title.partition(",")[0]]}


def _all_rows() -> list[BenchmarkRow]:
    rows: list[BenchmarkRow] = []
    for item in bench.measurements(None):
        rows += item.rows(_samples(item.title), {row.name: row.value for row in rows})
    return rows


def test_rows_have_the_keys_of_the_contract_and_distinct_names():
    rows = json.loads(json.dumps(bench.content(_all_rows())))["rows"]
    assert all(list(row) == KEYS for row in rows)
    assert len({row["name"] for row in rows}) == len(rows)
    assert all(row["value"] > 0 and row["unit"] for row in rows)
    for row in rows:
        assert (row["baseline"] is None) == (row["ratio"] is None)
        assert row["ratio"] is None or row["ratio"] == pytest.approx(row["value"] / row["baseline"])


def test_all_robots_and_both_meshes_are_measured():
    names = [row.name for row in _all_rows()]
    for robot in THESIS_ROBOTS:
        for cloth in (bench.CLOTH, bench.FINE_CLOTH):
            assert any(name.startswith(f"{robot} {cloth} in the air") for name in names)
            assert any(name.startswith(f"{robot} {cloth} loop / bare") for name in names)
            assert any(name.startswith(f"{robot} {cloth} seen and recorded") for name in names)
        assert any(name.startswith(f"{robot} GP") for name in names)


def test_simulated_over_wall_time():
    rows = {row.name: row for row in _all_rows()}
    row = rows["hanger towel in the air"]
    assert row.value == pytest.approx(STEP_S / 0.05)  # the median, which the slow block does not touch
    assert row.baseline == bench.AIR_GOAL
    assert rows["hanger towel-fine in the air"].baseline == row.value


def test_overhead_compares_neighbouring_blocks():
    item = next(iter(bench.measurements(None)))
    busy = np.array([1.0, 3.0, 1.0, 5.0, 2.0])  # what others do slows neighbours alike
    samples = _samples("physics") | {"air bare": 0.02 * busy, "air": 0.021 * busy}
    row = next(row for row in item.rows(samples, {}) if "bare, in the air" in row.name)
    assert row.ratio == pytest.approx(1.05)


def test_the_table_shows_every_row(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "110")
    rows = _all_rows()
    bench.print_results(rows)
    out = capsys.readouterr().out
    assert all(row.name in out for row in rows)


def test_a_prediction_is_really_timed():
    walls = measure.prediction("hanger")
    assert {len(wall) for wall in walls.values()} == {200}
    assert 0 < np.median(walls["predict"]) < 0.1
    assert np.median(walls["predict"] / walls["GPy"]) < 0.7


@pytest.mark.parametrize("robot", THESIS_ROBOTS)
def test_the_model_that_is_timed_gives_gpys_numbers(robot):
    """To 1e-8 of a unit of the processes, mean and deviation."""
    model = measure.random_model(robot, points=150)
    queries = np.random.default_rng(0).uniform(-0.4, 0.6, (30, model.layout.size))
    mean, std = (value / model.output_scale_m for value in model.predict(queries))
    for a, theirs in enumerate(measure.as_gpy(model)):
        want, variance = theirs.predict(queries / model.input_scale)
        np.testing.assert_allclose(mean[:, a], want[:, 0], atol=1e-8)
        np.testing.assert_allclose(std[:, a], np.sqrt(variance[:, 0]), atol=1e-8)


@pytest.mark.parametrize("config", [AXIAL_CONFIG, THESIS_CONFIG], ids=["word-axial", "word"])
def test_the_pipeline_gives_the_reference_numbers(config):
    assert measure_perception.reference_error(config) < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("robot", THESIS_ROBOTS)
def test_a_short_real_run(robot, tmp_path):
    with bench.process_pool(1) as pool:
        physics = pool.schedule(measure.physics, args=(robot, "towel", 2, 2)).result()
        seeing = pool.schedule(measure.seeing, args=(robot, "towel", tmp_path, 2)).result()
    assert all((walls > 0).all() for walls in (*physics.values(), *seeing.values()))
    assert np.median(physics["flat"]) > np.median(physics["air"])  # contact costs
    assert np.median(seeing["flat"]) > np.median(seeing["capture"])
    assert not list(tmp_path.iterdir())


def test_published_cloths_are_compared_with_ours_of_as_many_nodes():
    rows = {row.name: row for row in _all_rows()}
    for nodes in measure_solver_settings.NODES:
        for name in SOLVER_SETTINGS:
            row = rows[f"bare cloth {nodes} x {nodes} flat / {name}"]
            assert row.unit == RTF
            assert row.ratio == pytest.approx(1.0)


def test_an_evaluation_is_really_shared_by_workers(tmp_path):
    """Episodes that only wait take half as long two at a time."""
    # OpenCV's threads, which other tests have started here, do not survive the forks of an evaluation.
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        walls = pool.submit(measure_batch.scaling, "hanger", "towel", tmp_path, FakeEpisodes(step_s=0.4)).result()
    assert walls["1"] > 1.5 * walls["2"]
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_published_cloths_really_run():
    with bench.process_pool(1) as pool:
        samples = pool.schedule(measure_solver_settings.published_cloths, args=(10, "towel", 0.1, 2)).result()
    assert all((walls > 0).all() and len(walls) == 2 for walls in samples.values())
    assert len(measure_solver_settings.rows(10, samples, {})) == 4


@pytest.mark.slow
def test_recording_and_opening_are_really_measured(tmp_path):
    with bench.process_pool(1) as pool:
        recording = pool.schedule(measure_data.recording, args=(tmp_path, 3)).result()
        opening = pool.schedule(measure_data.opening, args=(tmp_path, 30)).result()
    assert len(recording["hand over"]) == 3
    assert np.median(recording["hand over"]) < np.median(recording["step"])
    assert recording["size gzip 4"] < recording["size gzip 1"] < recording["size lzf"] < recording["size none"]
    assert np.median(opening["open"]) < np.median(opening["read"]) * 30
    assert np.median(opening["columns"]) < np.median(opening["read"])
    assert not list(tmp_path.iterdir())


def test_a_reset_and_a_step_of_the_environment_are_really_timed():
    walls = measure_env.one("napkin", resets=1, steps=2)
    assert {name: len(wall) for name, wall in walls.items()} == {
        "reset": 1, "hanging": 1, "step": 2, "image": 2, "bare": 2
    }  # fmt: skip
    assert walls["reset"] < walls["hanging"]
