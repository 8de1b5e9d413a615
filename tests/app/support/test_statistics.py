"""Statistics against independent formulas."""

from __future__ import annotations

import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from layflat.app.support import statistics
from layflat.app.support.formatting import interval, list_numbers, percent, points, ratio


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


def test_a_description_has_the_numbers_of_the_sample_and_none_for_an_empty_one():
    sample = np.array([0.5, 0.7, 0.9])
    assert statistics.describe(sample).to_json() == {
        "n": 3, "mean": pytest.approx(0.7), "min": 0.5, "max": 0.9, "ci95": list(statistics.confidence_interval(sample))
    }  # fmt: skip
    assert statistics.describe(sample[:1]).to_json() == {
        "n": 1,
        "mean": 0.5,
        "min": 0.5,
        "max": 0.5,
        "ci95": [None] * 2,
    }
    assert statistics.describe(sample[:0]).to_json() == {
        "n": 0,
        "mean": None,
        "min": None,
        "max": None,
        "ci95": [None] * 2,
    }


@pytest.mark.parametrize(("k", "n"), [(0, 5), (5, 5), (7, 20), (19, 20), (250, 300)])
def test_wilson_interval_agrees_with_its_formula(k, n):
    z, p = 1.959963984540054, k / n
    centre = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * math.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    assert statistics.wilson_interval(k, n) == pytest.approx(
        [max(0.0, centre - half), min(1.0, centre + half)], abs=1e-12
    )


def test_numbers_have_their_unit_a_minus_sign_and_a_dash_where_they_are_missing():
    assert (percent(0.9651), points(-0.012), ratio(-0.5), interval(-0.01, 0.5, "+.1f")) == (
        "96.5 %", "\u22121.2", "\u22120.500", "\u22121.0 to +50.0"
    )  # fmt: skip
    assert {percent(None), points(math.nan), ratio(None), interval(math.nan, math.nan)} == {"\u2013"}


@pytest.mark.parametrize(
    ("numbers", "text"), [((2, 0, 1), "0\u20132"), ((3, 8, 5), "3, 5, 8"), ((1, 0), "0, 1"), ((7,), "7")]
)
def test_consecutive_numbers_are_a_range(numbers, text):
    assert list_numbers(numbers) == text
