"""Rows are what the contract says, and statistics what independent formulas say."""

from __future__ import annotations

import json
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from layflat.app.support import metrics, statistics
from layflat.data.types import DisturbanceRecord, Observation

CONTRACT = [
    "policy",
    "robot",
    "cloth",
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


def _with_contact(observation: Observation, contact: float) -> Observation:
    return replace(observation, contact_portion=contact)


def test_columns_are_those_of_the_contract_in_its_order(make_episode):
    assert list(metrics.episode_metrics(make_episode())) == CONTRACT == list(metrics.COLUMNS)


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


def test_of_repeated_disturbances_each_has_its_moments_and_the_row_the_last_ones(make_episode):
    """Into the placing, after it, and once more, which is never over."""
    lasting = [("wind", 10, 19), ("push", 60, 69), ("push", 80, None)]
    befell = [DisturbanceRecord(name=name, first_step=first, last_step=last) for name, first, last in lasting]
    episode = _numbered(make_episode(disturbances=befell))
    told = metrics.disturbed_contacts(episode)
    assert [contact.name for contact in told] == ["wind", "push", "push"]
    moments = [moment for contact in told for moment in (contact.before, contact.after, contact.final)]
    assert moments == pytest.approx([0.010, 0.020, 0.060, 0.060, 0.070, 0.080, 0.080, 0.095, 0.095])
    assert metrics.episode_metrics(episode)["contact_disturbed"] == pytest.approx(0.095)
    assert metrics.episode_metrics(replace(episode, disturbances=befell[:1]))["contact_disturbed"] == pytest.approx(
        0.020
    )


def test_where_only_the_phases_tell_of_a_disturbance_they_are_believed(make_episode):
    episode = _numbered(make_episode())
    (contact,) = metrics.disturbed_contacts(episode)
    first, over = episode.phase_bounds("disturb")
    assert contact.name == "push"
    assert (contact.before, contact.after) == pytest.approx((0.001 * first, 0.001 * over))
    assert metrics.disturbed_contacts(make_episode(disturbed=False)) == ()


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


@settings(deadline=None, max_examples=15)
@given(st.lists(st.floats(0, 1), min_size=2, max_size=20))
def test_interval_lies_within_the_range_and_is_repeatable(values):
    sample = np.array(values)
    low, high = statistics.confidence_interval(sample)
    assert sample.min() - 1e-12 <= low <= high <= sample.max() + 1e-12
    assert statistics.confidence_interval(sample) == (low, high)


def test_interval_agrees_with_the_normal_one_for_many_values():
    sample = np.random.default_rng(3).normal(0.9, 0.05, 400)
    half = norm.ppf(0.975) * sample.std() / np.sqrt(len(sample))
    low, high = statistics.confidence_interval(sample)
    assert low == pytest.approx(sample.mean() - half, abs=0.1 * half)
    assert high == pytest.approx(sample.mean() + half, abs=0.1 * half)


def test_an_intervals_memory_does_not_grow_with_its_values():
    """Of thousands of values it once took a quarter of a gigabyte."""
    peaks = []
    for n in (500, 8000):
        values = np.random.default_rng(n).uniform(size=n)
        tracemalloc.start()
        try:
            statistics.confidence_interval(values)
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    few, many = peaks
    assert many < 1.1 * few
    assert few < 4 * 8 * statistics.BATCH_VALUES <= 32e6  # What is drawn, where from, and a copy.


def test_an_interval_does_not_depend_on_how_many_values_are_drawn_at_a_time(monkeypatch):
    sample = np.random.default_rng(3).uniform(0.5, 1.0, 150)
    found = set()
    for at_a_time in (10**4, 10**6, 10**8):
        monkeypatch.setattr(statistics, "BATCH_VALUES", at_a_time)
        found.add(statistics.confidence_interval(sample))
    assert len(found) == 1


def test_one_value_has_no_interval_and_equal_values_have_a_point():
    assert np.isnan(statistics.confidence_interval(np.array([0.9]))).all()
    assert statistics.confidence_interval(np.array([0.9] * 5)) == pytest.approx((0.9, 0.9))


def test_summary_groups_by_policy_and_leaves_gain_empty_without_disturbance(make_episode):
    made = [make_episode(source="gp-word", seed=s, gain=0.1) for s in range(4)]
    made += [make_episode(source="gp-baseline", seed=s, disturbed=False) for s in range(3)]
    frame = statistics.summary([metrics.episode_metrics(episode) for episode in made]).set_index("policy")
    assert frame.loc["gp-word", "n"] == 4
    assert frame.loc["gp-word", "gain_mean"] == pytest.approx(0.1)
    assert frame.loc["gp-baseline", "n"] == 3
    assert np.isnan(frame.loc["gp-baseline", "gain_mean"])
    expected = np.mean([episode.contact()[-1] for episode in made[4:]])
    assert frame.loc["gp-baseline", "contact_final_mean"] == pytest.approx(expected)
