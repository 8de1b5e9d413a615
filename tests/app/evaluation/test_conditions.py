"""Conditions of an evaluation: set for all episodes, or drawn by each seed; in rows, files and on the page."""

from __future__ import annotations

import json
from dataclasses import replace

import pandas as pd
import pytest

from layflat.app.evaluation.results import EvaluationResults
from layflat.app.evaluation.run import run_evaluation
from layflat.app.report.blocks import Figure, TableBlock
from layflat.app.report.conditions import bins, conditions_section, drawn_keys
from layflat.app.support.errors import UsageError
from layflat.app.workers.sim_options import parse_variation
from layflat.app.workers.work_item import WorkItem
from layflat.sim.conditions.variation import variation
from layflat.sim.errors import SimError
from layflat.tests.app.fake_episodes import FakeEpisodes, fake_plan

VARIED = replace(fake_plan(seeds=2), settings=("depth_noise=2",), variation=variation(["cloths"]))


@pytest.fixture(scope="module")
def results(tmp_path_factory) -> EvaluationResults:
    return run_evaluation(VARIED, tmp_path_factory.mktemp("varied"), workers=3, make=FakeEpisodes())


def test_every_row_and_every_session_says_what_was_set_and_drawn(results):
    for row in results.rows.to_dict(orient="records"):
        expected = {"depth_noise": 2.0, **variation(["cloths"]).sample(row["seed"])}
        assert row["conditions"] == expected
        assert results.episode(row["run"]).sim_config.items() >= expected.items()
    summary = json.loads((results.folder / "summary.json").read_text())
    assert [row["conditions"] for row in summary["episodes"]] == list(results.rows["conditions"])


def test_policies_and_disturbed_and_undisturbed_episodes_of_a_seed_meet_the_same_draw(results):
    groups = results.rows.groupby("seed")["conditions"]
    assert all(group.map(json.dumps).nunique() == 1 and len(group) == 6 for _, group in groups)
    assert results.rows["conditions"].map(json.dumps).nunique() == 2


def test_a_continued_evaluation_keeps_its_draws_and_another_one_is_refused(results):
    before = list(results.rows["run"])
    more = replace(VARIED, seeds=(0, 1, 2))
    again = run_evaluation(more, results.folder, workers=3, make=FakeEpisodes())
    kept = again.rows[again.rows["run"].isin(before)]
    assert list(kept["conditions"]) == list(results.rows["conditions"])
    for other in (replace(VARIED, variation=variation(["light"])), replace(VARIED, settings=())):
        with pytest.raises(UsageError, match=r"contains an evaluation whose (variation|settings) is"):
            run_evaluation(other, results.folder, make=FakeEpisodes())


def test_an_episode_whose_draw_cannot_be_simulated_is_counted_and_the_others_come(tmp_path):
    def make(item: WorkItem, on_start):
        if item.config.mass_factor < 1.0:
            raise SimError("the cloth diverged while it was hung")
        return FakeEpisodes()(item, on_start)

    rows = run_evaluation(VARIED, tmp_path, workers=3, make=make).rows
    light = rows["conditions"].map(lambda given: given["mass_factor"] < 1.0)
    assert 0 < light.sum() < len(rows)
    assert list(rows["crashed"]) == list(light)
    assert set(rows.loc[light, "reason"]) == {"the cloth diverged while it was hung"}


def test_the_page_shows_results_against_each_drawn_quantity_and_nothing_that_was_set(results):
    section = conditions_section(results.rows)
    assert section is not None
    names = [draw.key for draw in variation(["cloths"]).draws]
    assert sorted(drawn_keys(results.rows)) == sorted(names)
    figure, block = section.blocks
    assert isinstance(figure, Figure)
    assert isinstance(block, TableBlock)
    assert len(figure.panels) == len(names)
    for name in names:
        assert sum(int(line[3]) for line in block.table.rows if line[0] == name) == len(results.rows)
    plain = run_evaluation(fake_plan(seeds=1), results.folder / "plain", workers=3, make=FakeEpisodes())
    assert conditions_section(plain.rows) is None


def test_bins_hold_equal_numbers_and_words_stay_words(results):
    drawn = results.rows["seed"].map(lambda seed: seed / 7).astype(float)
    assert bins(drawn.head(3)).tolist() == [str(value) for value in drawn.head(3)]
    many = bins(pd.Series([float(k) for k in range(40)]))
    assert many.value_counts().tolist() == [10] * 4
    assert bins(pd.Series(["impedance", "position"])).tolist() == ["impedance", "position"]


def test_a_condition_that_is_set_and_drawn_is_refused():
    with pytest.raises(UsageError, match="--set gives mass_factor a value, and --vary cloths draws it; leave one out"):
        parse_variation(["cloths"], ["mass_factor=1"])
