"""The numbers of a summary against independent formulas and counts."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest

from layflat.app.evaluation.results_csv import ALL_COLUMNS
from layflat.app.evaluation.summary import summary_of, with_measures
from layflat.app.support.statistics import wilson_interval


def _rows(*lines: dict) -> pd.DataFrame:
    """Rows of one group unless said otherwise, each with a seed of its own for each policy and case."""
    usual = {
        "policy": "a",
        "robot": "hanger",
        "task": "place",
        "cloth": "towel",
        "physics": "bullet",
        "disturbance": "none",
        "contact_disturbed": math.nan,
        "contact_final": 0.9,
        "contact_final_true": 0.9,
        "flat_area_final": 1.0,
        "unstable": False,
        "crashed": False,
        "attempts": 1,
    }
    seeds: dict[tuple, int] = {}
    rows = []
    for line in lines:
        row = {**dict.fromkeys(ALL_COLUMNS), **usual, **line}
        key = (row["policy"], row["cloth"], row["disturbance"])
        row["seed"] = line.get("seed", seeds.setdefault(key, 0))
        seeds[key] = row["seed"] + 1
        rows.append(row)
    frame = pd.DataFrame(rows)
    for name in ("contact_final", "contact_disturbed", "contact_final_true", "flat_area_final"):
        frame[name] = frame[name].astype(float)
    return frame


def test_a_group_has_the_mean_the_range_and_an_interval_as_wide_as_the_central_limit_says():
    values = np.random.default_rng(0).uniform(0.5, 1.0, 400)
    (group,) = summary_of(_rows(*({"contact_final": v} for v in values)))["groups"]
    final = group["contact_final"]
    assert (final["n"], final["min"], final["max"]) == (400, values.min(), values.max())
    assert final["mean"] == pytest.approx(values.mean())
    half = 1.96 * values.std() / 20
    assert final["ci95"] == pytest.approx([values.mean() - half, values.mean() + half], abs=0.1 * half)
    assert group["gain"] == {"n": 0, "mean": None, "min": None, "max": None, "ci95": [None, None]}


def test_without_a_mesh_the_cameras_contact_says_whether_the_cloth_is_flat():
    unknown = {"contact_final_true": math.nan, "flat_area_final": math.nan}
    (group,) = summary_of(_rows(*({**unknown, "contact_final": contact} for contact in (0.99, 0.98, 0.9))))["groups"]
    assert group["success_rate"] == pytest.approx(2 / 3)


def test_success_is_flat_and_neither_unstable_nor_crashed():
    crashed = {"contact_final": math.nan, "contact_final_true": math.nan, "flat_area_final": math.nan, "crashed": True}
    (group,) = summary_of(_rows({}, {}, {"flat_area_final": 0.9}, {"unstable": True}, {**crashed, "attempts": 2}))[
        "groups"
    ]
    assert (group["n"], group["unstable"], group["crashed"]) == (5, 1, 1)
    assert group["success_rate"] == pytest.approx(2 / 5)
    assert group["success_wilson95"] == list(wilson_interval(2, 5))
    assert group["contact_final"]["n"] == 4


def test_pairs_are_of_the_same_start_and_leave_out_what_has_no_partner():
    rows = _rows(
        *({"policy": "a", "contact_final": v} for v in (0.5, 0.6, 0.7)),
        *({"policy": "b", "contact_final": v, "seed": s} for s, v in ((2, 0.9), (0, 0.6), (7, 0.1))),
    )
    (pair,) = summary_of(rows)["paired"]
    assert (pair["a"], pair["b"], pair["disturbance"]) == ("a", "b", "none")
    found = pair["contact_final"]
    assert found["n"] == 2
    assert [found["mean"], found["min"], found["max"]] == pytest.approx([0.15, 0.1, 0.2])
    assert found["ci95"] == pytest.approx([0.1, 0.2])


def test_a_pairing_finds_what_the_spread_between_starts_hides():
    rng = np.random.default_rng(1)
    start = rng.uniform(0.2, 0.9, 30)
    better = start + 0.02 + rng.normal(0, 0.005, 30)
    rows = _rows(
        *({"policy": "a", "contact_final": v} for v in start), *({"policy": "b", "contact_final": v} for v in better)
    )
    summary = summary_of(rows)
    low, high = summary["paired"][0]["contact_final"]["ci95"]
    assert 0.015 < low < 0.02 < high < 0.025
    a, b = (group["contact_final"]["ci95"] for group in summary["groups"])
    assert a[1] > b[0]


def test_twins_are_the_disturbed_less_the_undisturbed_of_one_policy():
    rows = _rows(
        *({"policy": p, "contact_final": v} for p in "ab" for v in (0.9, 0.8)),
        *(
            {"policy": p, "disturbance": "push", "contact_disturbed": 0.5, "contact_final": v}
            for p, v in zip("aabb", (0.8, 0.6, 0.9, 0.8), strict=True)
        ),
    )
    twins = {twin["policy"]: twin["contact_final"] for twin in summary_of(rows)["twins"]}
    assert twins["a"]["mean"] == pytest.approx(-0.15)
    assert twins["b"]["mean"] == pytest.approx(0.0)
    gains = [group["gain"]["mean"] for group in summary_of(rows)["groups"] if group["disturbance"] == "push"]
    assert gains == pytest.approx([0.2, 0.35])


def test_a_gain_that_is_there_is_kept():
    rows = _rows({"contact_disturbed": 0.5, "contact_final": 0.9})
    assert with_measures(rows)["gain"].tolist() == pytest.approx([0.4])
    assert with_measures(rows.assign(gain=0.1))["gain"].tolist() == [0.1]
