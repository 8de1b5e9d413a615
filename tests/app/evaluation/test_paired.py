"""Paired differences, and the words for them."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from layflat.app.evaluation.paired import compare_paired
from layflat.app.report.comparison_sentences import comparison_sentence, verdict


def _rows(contact_final):
    n = len(contact_final)
    condition = {"robot": "hanger", "task": "place", "cloth": "towel", "physics": "bullet", "disturbance": "none"}
    return pd.DataFrame({"seed": np.arange(n)}).assign(**condition, contact_final=contact_final)


def test_pairs_are_matched_by_start_in_any_order():
    of_start = np.random.default_rng(0).normal(0, 1, 12)
    a = _rows(of_start + 0.01).sample(frac=1, random_state=1)
    b = _rows(of_start).iloc[2:]
    pair = compare_paired(a, b, "contact_final")
    assert (pair.n, pair.n_higher, pair.n_lower) == (10, 10, 0)
    assert pair.mean == pytest.approx(0.01)
    assert pair.is_significant
    assert verdict(pair) == "higher"
    assert "higher with a than with b" in comparison_sentence("a", "b", "contact_final", pair)
    assert verdict(compare_paired(b, a, "contact_final")) == "lower"


def test_nothing_is_concluded_where_the_interval_holds_zero_or_pairs_are_few():
    rng = np.random.default_rng(3)
    a, b = (_rows(rng.normal(0.9, 0.05, 20)) for _ in range(2))
    pair = compare_paired(a, b, "contact_final")
    assert pair.low < 0 < pair.high
    assert not pair.is_significant
    for n, words in ((20, "no difference"), (5, "too few"), (1, "too few"), (0, "no pair")):
        found = compare_paired(a[:n], b[:n], "contact_final")
        assert words in verdict(found)
        assert words in comparison_sentence("a", "b", "contact_final", found)
    better = compare_paired(_rows(np.full(5, 0.9)), _rows(np.full(5, 0.1)), "contact_final")
    assert better.low > 0
    assert not better.is_significant, "five pairs are too few"
    assert "the same in all 20" in verdict(compare_paired(a, a, "contact_final"))
