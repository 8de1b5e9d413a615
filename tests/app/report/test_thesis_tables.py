"""Tables 4-1 and 4-2: the thesis's numbers as it states them, ours as the episodes have them."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from layflat.app.report import thesis_numbers as thesis
from layflat.app.report.thesis_tables import disturbance_table, placing_table, with_outcomes
from layflat.app.support.metrics import episode_metrics
from layflat.app.support.phases import disturbance_outcomes

GAINS = {"gp-word": 0.08, "gp-baseline": 0.0}


@pytest.fixture(scope="module")
def episodes(make_episode):
    return {
        f"{name}-{s}": make_episode(source=name, seed=s, gain=gain) for name, gain in GAINS.items() for s in range(3)
    }


@pytest.fixture(scope="module")
def rows(episodes):
    rows = pd.DataFrame([episode_metrics(episode) | {"run": run} for run, episode in episodes.items()])
    return with_outcomes(rows, lambda run: disturbance_outcomes(episodes[run]))


def test_the_disturbance_table_holds_the_means_of_the_episodes(rows, episodes):
    table = disturbance_table(rows)
    ours = {line[0]: line for k, line in enumerate(table.rows) if k not in table.cited}
    assert set(ours) == set(GAINS)
    assert (ours["gp-word"][1], ours["gp-word"][5].split()[0]) == ("3", "+8.0")
    assert ours["gp-baseline"][5].split()[0] == "+0.0"
    placed = [episode.contact()[episode.phase_bounds("place")[1]] for run, episode in episodes.items() if "word" in run]
    assert ours["gp-word"][2].startswith(f"{100 * np.mean(placed):.1f} %")
    assert len(table.cited) == sum(map(len, thesis.DISTURBANCE.values()))
    assert all(len(line) == len(table.header) for line in table.rows)


def test_the_placing_table_cites_the_thesis_above_ours(rows):
    table = placing_table(rows)
    assert [line[0] for line in table.rows] == ["gp-baseline, thesis", "gp-baseline", "gp-word, thesis", "gp-word"]
    assert table.cited == {0, 2}
    assert table.rows[2][2:5] == ("98.3 %", "96.5 %", "91.5 %")
    finals = rows.loc[rows["policy"] == "gp-word", "contact_final"]
    assert table.rows[3][2:5] == tuple(f"{100 * value:.1f} %" for value in (finals.max(), finals.mean(), finals.min()))
    alone = placing_table(rows, cite=False)
    assert (len(alone.rows), alone.cited) == (2, frozenset())
    assert len(disturbance_table(rows, cite=False).rows) == 2


def test_crashed_episodes_have_no_outcomes(rows):
    crashed = rows.assign(crashed=True)
    for table in (placing_table(crashed, cite=False), disturbance_table(with_outcomes(crashed, lambda run: ()))):
        assert all(len(line) == len(table.header) for line in table.rows)
    assert "disturbed_1" not in with_outcomes(rows[list(rows.columns[:18])].assign(crashed=True), lambda run: ())


@pytest.mark.parametrize(("policy", "low", "high"), [(thesis.BASELINE, -0.01, 0.01), (thesis.PROPOSED, 0.045, 0.11)])
def test_the_gains_of_the_thesis_are_those_that_it_states(policy, low, high):
    """Chapter 4-3-3: the baseline changes by less than 1 %, the proposed method gains around 5 to 10 %."""
    assert all(low < gain < high for gain in thesis.regained(policy))
