"""The page of a batch: its numbers are the rows', its pictures the episodes', and a browser shows all of it."""

from __future__ import annotations

import base64
import re
from dataclasses import replace

import cv2
import numpy as np
import pandas as pd
import pytest

from layflat.app.evaluation.paired import compare_paired
from layflat.app.evaluation.phases import disturbance_outcomes, phase_spans
from layflat.app.evaluation.summary import with_measures
from layflat.app.report import charts
from layflat.app.report.comparison_sentences import verdict
from layflat.app.report.episode_renderer import EpisodeRenderer, key_steps
from layflat.app.report.evaluation import evaluation_page, examples
from layflat.app.report.page import markdown, table_markdown, write_page
from layflat.app.report.result_tables import failures, group_table
from layflat.app.report.tables import Table
from layflat.app.support.metrics import episode_metrics
from layflat.data.types import GroundTruth
from layflat.sim.cloth.cloth import cloth_spec
from layflat.tests.browser import measured, needs_chromium, screenshot

POLICIES = ("gp-baseline", "gp-word", "gp-baseline+drag-rule")
CONDITIONS = (("hanger", False), ("pickers", True))
SEEDS = range(6)
NUMBERS = ("contact_final", "contact_disturbed", "flat_area_final", "steps", "sim_s")


class Drawn:
    """A batch of drawn episodes; the last one crashed."""

    def __init__(self, episodes):
        self.episodes = {f"{e.robot}--{e.source}--{e.seed}--{e.disturbance}": e for e in episodes}
        rows = [episode_metrics(e) | {"run": run, "reason": ""} for run, e in self.episodes.items()]
        rows[-1] |= dict.fromkeys(("contact_final", "contact_disturbed", "flat_area_final", "steps", "sim_s"))
        rows[-1] |= {"crashed": True, "stopped_by": "crashed", "reason": "its process ended with status -11"}
        self.rows = pd.DataFrame(rows).astype(dict.fromkeys(NUMBERS, float))

    def episode(self, run):
        assert self.rows.set_index("run").loc[run, "crashed"] == False, "a crashed episode has no record"  # noqa: E712
        return self.episodes[run]


def laid(episode, *, lift_m=0.15):
    """The episode with a towel whose part that is not in contact stands up from the table, towards the held edge."""
    spec = cloth_spec(episode.cloth)
    flat = spec.flat_nodes(x_m=0.25)
    along = (flat[:, 0] - flat[:, 0].min()) / np.ptp(flat[:, 0])

    def ground_truth(old, contact):
        nodes = flat.copy()
        nodes[:, 2] += lift_m * np.clip(along - contact, 0, None)
        return GroundTruth(nodes=nodes, contact_portion_true=old.contact_portion_true, flat_area=old.flat_area)

    contact = episode.contact()
    steps = tuple(
        replace(step, ground_truth=ground_truth(step.ground_truth, contact[step_index]))
        for step_index, step in enumerate(episode.steps)
    )
    return replace(episode, steps=steps, final_ground_truth=ground_truth(episode.final_ground_truth, contact[-1]))


@pytest.fixture(scope="module")
def batch(make_episode):
    gains = {"gp-baseline": 0.0, "gp-word": 0.11, "gp-baseline+drag-rule": 0.105}
    return Drawn(
        laid(
            make_episode(
                robot=robot, source=policy, seed=seed, disturbed=disturbed, gain=gains[policy] + 0.005 * (seed % 3)
            )
        )
        for robot, disturbed in CONDITIONS
        for policy in POLICIES
        for seed in SEEDS
    )


@pytest.fixture(scope="module")
def content(batch):
    """What the page shows, made once for all tests."""
    with EpisodeRenderer() as painter:
        return evaluation_page(
            batch, painter, title="A batch of drawn <episodes>", made=("layflat evaluate", "numpy 2")
        )


@pytest.fixture(scope="module")
def page(content, tmp_path_factory):
    """The page as a file."""
    path = tmp_path_factory.mktemp("evaluation") / "report.html"
    write_page(path, content)
    return path


def test_the_page_is_one_file_without_scripts_that_needs_nothing_else(page):
    assert [found.name for found in page.parent.iterdir()] == ["report.html"]
    text = re.sub(r"data:[a-z/]+;base64,[A-Za-z0-9+/=]+", "DATA", page.read_text(encoding="utf-8"))
    assert not re.search(r"https?://|<script|<link(?! rel=\"icon\" href=\"data:)|@import|url\(", text)
    assert set(re.findall(r"src=\"([^\"]*)\"", text)) == {"DATA"}
    assert "A batch of drawn &lt;episodes&gt;" in text


def test_every_condition_has_its_boxes_its_curves_and_three_strips_a_policy(page):
    text = page.read_text(encoding="utf-8")
    pictures = re.findall(r"data:image/(png|jpeg);base64,([A-Za-z0-9+/=]+)", text)
    assert sum(kind == "png" for kind, _ in pictures) == len(CONDITIONS) * 2
    assert sum(kind == "jpeg" for kind, _ in pictures) == len(CONDITIONS) * len(POLICIES) * 3 * 6
    for _, picture in pictures[:10]:
        image = cv2.imdecode(np.frombuffer(base64.b64decode(picture), np.uint8), cv2.IMREAD_COLOR)
        assert image.std() > 5


def test_a_film_is_made_of_each_example_when_asked_for(batch):
    few = batch.rows[(batch.rows["robot"] == "pickers") & (batch.rows["policy"] == "gp-word")]

    class Few:
        rows = few
        episode = staticmethod(batch.episode)

    with EpisodeRenderer() as painter:
        page = evaluation_page(Few(), painter, title="t", made=(), videos=True)
        films = [block for block in page.sections[0].blocks if type(block).__name__ == "Film"]
        assert len(films) == 3
        assert next(iter(films[0].frames())).shape[1] == 480


def test_the_table_holds_what_the_rows_say(batch):
    rows = batch.rows[(batch.rows["robot"] == "pickers") & (batch.rows["disturbance"] == "push")]
    lines = {line[0]: line for line in group_table(rows).rows}
    mine = rows[rows["policy"] == "gp-word"]
    assert lines["gp-word"][3] == f"{100 * mine['contact_final'].mean():.1f} %"
    assert lines["gp-word"][6] == f"{100 * (mine['contact_final'] - mine['contact_disturbed']).mean():+.1f}"
    assert lines["gp-baseline+drag-rule"][1] == str(len(SEEDS))  # the crashed one counts, but has no numbers
    assert lines["gp-baseline+drag-rule"][10].endswith(f"of {len(SEEDS)}")


def test_a_crash_is_told_with_its_reason_and_is_no_success(batch, page):
    text = page.read_text(encoding="utf-8")
    assert "1 of 36 episodes crashed" in text
    assert "its process ended with status -11" in text
    assert not with_measures(batch.rows)["success"].iloc[-1]
    assert failures(batch.rows).iloc[-1] == "crashed"


def test_examples_are_the_best_the_median_and_the_worst_once_each(batch):
    rows = batch.rows[(batch.rows["policy"] == "gp-word") & (batch.rows["disturbance"] == "push")]
    picks = dict(examples(rows))
    finals = rows["contact_final"]
    assert picks["best"]["contact_final"] == finals.max()
    assert picks["worst"]["contact_final"] == finals.min()
    assert finals.quantile(0.4) <= picks["median"]["contact_final"] <= finals.quantile(0.6)
    assert [name for name, _ in examples(rows[:1])] == ["worst"]
    assert [name for name, _ in examples(rows[:0])] == []


def test_pairs_are_matched_by_start_whatever_the_order():
    rng = np.random.default_rng(0)
    seeds = np.arange(12)
    base = pd.DataFrame({"robot": "hanger", "cloth": "towel", "disturbance": "none", "seed": seeds})
    of_start = rng.normal(0, 1, 12)
    a = base.assign(contact_final=of_start + 0.01).sample(frac=1, random_state=1)
    b = base.assign(contact_final=of_start).iloc[2:]
    found = compare_paired(a, b, "contact_final")
    assert (found.n, found.better, found.worse) == (10, 10, 0)
    assert found.mean == pytest.approx(0.01)
    assert found.clear
    assert verdict(found) == "higher"


def test_no_difference_is_said_where_the_interval_holds_zero():
    rng = np.random.default_rng(3)
    base = pd.DataFrame({"robot": "hanger", "cloth": "towel", "disturbance": "none", "seed": np.arange(20)})
    a, b = (base.assign(contact_final=rng.normal(0.9, 0.05, 20)) for _ in range(2))
    found = compare_paired(a, b, "contact_final")
    assert found.low < 0 < found.high
    assert verdict(found) == "no difference that 20 pairs can show"
    assert verdict(compare_paired(a[:1], b[:1], "contact_final")) == "1 pair is too few to say"
    assert verdict(compare_paired(a[:5], b[:5], "contact_final")) == "5 pairs are too few to say"
    assert verdict(compare_paired(a, a, "contact_final")) == "the same in all 20 pairs"


def test_rounds_tell_two_disturbances_apart(make_episode):
    once = make_episode(gain=0.08)
    begin, end = once.phase_bounds("disturb")[0], once.phase_bounds("repair")[1]
    again = replace(once.steps[begin], observation=once.final_observation)
    twice = replace(once, steps=(*once.steps, again, *once.steps[begin + 1 : end]))
    assert [part.phase for part in phase_spans(twice)] == ["place", "disturb", "repair", "disturb", "repair"]
    first, second = disturbance_outcomes(twice)
    assert first.regained == pytest.approx(0.08)
    assert second.regained == pytest.approx(0.08)
    assert first.before == pytest.approx(0.96, abs=0.02)
    assert second.before == pytest.approx(0.82 + 0.08)
    assert disturbance_outcomes(make_episode(disturbed=False)) == ()


def test_key_moments_are_in_order_and_begin_and_end_with_the_episode(make_episode):
    for disturbed in (False, True):
        episode = make_episode(disturbed=disturbed)
        n_steps = key_steps(episode, 6)
        assert n_steps == sorted(set(n_steps))
        assert (len(n_steps), n_steps[0], n_steps[-1]) == (6, 0, len(episode.steps))
        assert {part.after for part in phase_spans(episode)} <= set(n_steps)
    assert len(key_steps(episode, 3)) == 3


def test_the_band_is_the_quartiles_and_ended_runs_keep_their_value(make_episode):
    group = [charts.curve_of(make_episode(seed=s, gain=0.02 * s)) for s in range(5)]
    _, quartiles = charts.quartiles_over_time(group)
    finals = [curve.contact[-1] for curve in group]
    assert quartiles[:, -1] == pytest.approx(np.percentile(finals, [25, 50, 75]))
    assert (np.diff(quartiles, axis=0) >= 0).all()
    short = charts.Curve(time_s=group[0].time_s[:30], contact=group[0].contact[:30], spans_s=())
    _, alone = charts.quartiles_over_time([short, group[0]])
    assert alone[1, -1] == pytest.approx((short.contact[-1] + group[0].contact[-1]) / 2)


def test_markdown_has_every_table_and_no_cell_that_breaks_it(content):
    table = Table(("a", "b"), (("x | y", "1"),), (True,))
    assert table_markdown(table).splitlines()[-1] == "| x \\| y | 1 |"
    text = markdown(content)
    assert text.startswith("# A batch of drawn <episodes>\n")
    assert text.count("| --- |") == 2 * len(CONDITIONS) + 1


@needs_chromium
@pytest.mark.parametrize("width", [1280, 800])
def test_a_browser_shows_all_of_it(page, tmp_path, width):
    """Nothing reaches beyond the window; at 1280 no table has to be scrolled either, and no picture is broken."""
    found = measured(page, tmp_path, width)
    assert (found["overflow"], found["wide"], found["broken"]) == (0, 0, 0)
    assert width < 1280 or found["cut"] == 0
    image = screenshot(page, tmp_path, width)
    assert image.shape[:2] == (1600, width)
    assert image.std() > 20
