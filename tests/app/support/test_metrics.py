"""Rows are what the contract says."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from layflat.app.support import metrics
from layflat.data.types import DisturbanceRecord, Observation

CONTRACT = [
    "policy",
    "robot",
    "task",
    "cloth",
    "physics",
    "seed",
    "disturbance",
    "contact_start",
    "contact_placed",
    "contact_disturbed",
    "contact_final",
    "contact_final_true",
    "flat_area_final",
    "steps",
    "stopped_by",
    "unstable",
    "crashed",
    "sim_s",
    "wall_s",
]
ADDED = ["conditions", "decision_ms"]
"""Columns behind those of the contract."""


def _with_contact(observation: Observation, contact: float) -> Observation:
    return replace(observation, contact_portion=contact)


def test_columns_are_those_of_the_contract_in_its_order(make_episode):
    assert list(metrics.episode_metrics(make_episode())) == [*CONTRACT, *ADDED] == list(metrics.COLUMNS)


def test_moments_are_those_at_the_end_of_each_phase(make_episode):
    episode = _numbered(make_episode())
    row, steps = metrics.episode_metrics(episode), episode.steps
    first_disturbed = next(i for i, step in enumerate(steps) if step.phase == "disturb")
    first_repair = next(i for i, step in enumerate(steps) if step.phase == "repair")
    assert row["contact_start"] == 0.0
    assert row["contact_placed"] == pytest.approx(0.001 * first_disturbed)
    assert row["contact_disturbed"] == pytest.approx(0.001 * first_repair)
    assert row["contact_final"] == pytest.approx(0.001 * len(steps))


def test_without_disturbance_that_moment_is_null_and_placed_is_final(make_episode):
    row = metrics.episode_metrics(make_episode(disturbed=False))
    assert row["contact_disturbed"] is None
    assert row["disturbance"] == "none"
    assert row["contact_placed"] == row["contact_final"]


def _numbered(episode):
    """Contact portion 0.001 in step 1, 0.002 in step 2, ..."""
    seen = [_with_contact(o, 0.001 * step_index) for step_index, o in enumerate(episode.observations())]
    steps = tuple(replace(step, observation=o) for step, o in zip(episode.steps, seen[:-1], strict=True))
    return replace(episode, steps=steps, final_observation=seen[-1])


def test_the_disturbed_moment_is_the_end_of_the_last_disturbance(make_episode):
    spans = [("wind", 10, 19), ("push", 60, 69), ("push", 80, None)]
    records = [DisturbanceRecord(name=name, first_step=first, last_step=last) for name, first, last in spans]
    episode = _numbered(make_episode(disturbances=records))
    assert metrics.episode_metrics(episode)["contact_disturbed"] == pytest.approx(0.095)
    once = replace(episode, disturbances=records[:1])
    assert metrics.episode_metrics(once)["contact_disturbed"] == pytest.approx(0.020)


def test_an_episode_that_never_began_placing_has_no_placed_moment(make_episode):
    row = metrics.episode_metrics(replace(make_episode(), steps=(), stopped_by="crashed", outcome="failure"))
    assert row["contact_placed"] is None
    assert (row["steps"], row["sim_s"], row["crashed"], row["unstable"]) == (0, 0.0, True, False)


def test_sensor_noise_above_one_is_cut_off(make_episode):
    episode = make_episode(disturbed=False)
    row = metrics.episode_metrics(replace(episode, final_observation=_with_contact(episode.final_observation, 1.03)))
    assert row["contact_final"] == 1.0


def test_simulated_time_is_steps_times_step(make_episode):
    row = metrics.episode_metrics(make_episode(step_s=0.2))
    assert row["sim_s"] == pytest.approx(row["steps"] * 0.2)


def test_json_has_the_schema_and_survives_a_round_trip(tmp_path, make_episode):
    path = tmp_path / "rows.json"
    row = metrics.episode_metrics(make_episode())
    metrics.write_json(path, {"episodes": [row], "extra": np.float64(0.5)})
    content = json.loads(path.read_text())
    assert content == {"schema": 1, "episodes": [row], "extra": 0.5}


def test_json_that_cannot_be_written_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "rows.json"
    metrics.write_json(path, {"episodes": []})
    before = path.read_bytes()
    with pytest.raises(TypeError, match="object"):
        metrics.write_json(path, {"episodes": object()})
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["rows.json"]
