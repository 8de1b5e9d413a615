"""The page of an evaluation: its numbers are the rows', its pictures the episodes', and a browser shows all of it."""

from __future__ import annotations

import base64
import re

import cv2
import numpy as np
import pandas as pd
import pytest

from layflat.app.evaluation.summary import with_measures
from layflat.app.media.episode_renderer import EpisodeRenderer
from layflat.app.report import charts
from layflat.app.report.blocks import Section, Table, TableBlock, Text, VideoBlock
from layflat.app.report.evaluation_page import PageOptions, evaluation_page
from layflat.app.report.examples import EXAMPLES, example_rows, film_runs
from layflat.app.report.headline import headline_cards
from layflat.app.report.page import markdown, table_markdown
from layflat.app.report.result_tables import episode_table, failures, group_table
from layflat.tests.app.report.conftest import CONDITIONS, POLICIES, SEEDS
from layflat.tests.browser import measured, needs_chromium, screenshot


def test_the_page_is_self_contained(page):
    assert [found.name for found in page.parent.iterdir()] == ["report.html"]
    text = re.sub(r"data:[a-z/]+;base64,[A-Za-z0-9+/=]+", "DATA", page.read_text(encoding="utf-8"))
    assert not re.search(r"https?://|<script|<link(?! rel=\"icon\" href=\"data:)|@import|url\((?!#)", text)
    assert set(re.findall(r"src=\"([^\"]*)\"", text)) == {"DATA"}
    assert "An evaluation of made-up &lt;episodes&gt;" in text


def test_every_condition_has_its_boxes_its_curves_and_three_strips_a_policy(page):
    text = page.read_text(encoding="utf-8")
    pictures = re.findall(r"<img src=\"data:image/jpeg;base64,([A-Za-z0-9+/=]+)", text)
    assert len(pictures) == len(CONDITIONS) * len(POLICIES) * 3 * 6
    assert [figure.count("<svg") for figure in re.findall(r"<div class=\"panels\".*?</div>", text, re.DOTALL)] == [2, 3]
    for picture in pictures[:10]:
        image = cv2.imdecode(np.frombuffer(base64.b64decode(picture), np.uint8), cv2.IMREAD_COLOR)
        assert image.std() > 5


def test_kinds_of_blocks_are_those_that_the_template_knows(page, content):
    text = page.read_text(encoding="utf-8")
    assert text.count('<div class="strip"') == len(CONDITIONS) * len(POLICIES) * 3
    for section in content.sections:
        for block in section.blocks:
            if isinstance(block, TableBlock):
                assert all(f"<th>{cell}</th>" in text for cell in block.table.header)
            if isinstance(block, Text):
                assert all(line in text for line in block.lines)


@pytest.fixture(scope="module")
def pickers(batch):
    """The disturbed condition alone."""

    class Pickers:
        rows = batch.rows[batch.rows["robot"] == "pickers"]
        episode = staticmethod(batch.episode)

    return Pickers()


def test_films_are_of_the_worst_and_the_typical_disturbed_ones_first(batch, pickers):
    rows = batch.rows
    picks = {name: row["run"] for name, row in example_rows(pickers.rows[pickers.rows["policy"] == "gp-word"])}
    assert film_runs(rows, 2, "gp-word") == {picks["worst"], picks["typical"]}
    assert film_runs(rows, 0) == set()
    assert len(film_runs(rows, None)) == len(CONDITIONS) * len(POLICIES) * len(EXAMPLES)
    disturbed = rows.set_index("run")["disturbance"] != "none"
    assert all(disturbed[run] for run in film_runs(rows, 6))


def test_a_film_plays_has_a_picture_for_paper_and_a_text(content, page):
    films = [block for section in content.sections for block in section.blocks if isinstance(block, VideoBlock)]
    text = page.read_text(encoding="utf-8")
    shown = re.findall(r"<video src=\"data:video/webm;base64,[^\"]+\" poster=\"data:image/jpeg;base64,[^\"]+\" "
                       r"aria-label=\"film of ([^\"]*)\"", text)  # fmt: skip
    assert shown == [f"{film.policy}, {film.caption}" for film in films]
    assert len(films) == text.count('<img class="poster" src="data:image/jpeg') == 2
    assert all(film.poster.shape[1] == 480 and film.poster.std() > 5 for film in films)


def test_a_row_leads_to_its_episode(batch, page):
    text = page.read_text(encoding="utf-8")
    for run in batch.rows["run"]:
        assert f"layflat replay runs/{run}.h5 --episode 0" in text
    links = re.findall(r"href=\"#((?:film|frames)-[^\"]*)\"", text)
    assert len(links) == len(set(links)) == len(CONDITIONS) * len(POLICIES) * len(EXAMPLES)
    assert all(f'id="{link}"' in text for link in links)


def test_the_headline_keeps_disturbed_and_undisturbed_episodes_and_robots_apart(batch):
    rows = batch.rows
    cards = {card.name: card.values for card in headline_cards(rows)}
    assert list(cards) == [f"{policy}, {robot}" for robot, _ in CONDITIONS for policy in POLICIES]
    both = pd.concat([rows[rows["robot"] == "pickers"], rows[rows["robot"] == "pickers"].assign(disturbance="none")])
    both.loc[both["disturbance"] == "none", ["contact_final", "contact_disturbed"]] = 0.25, float("nan")
    (card,) = [card for card in headline_cards(both) if card.name == "gp-word"]
    assert [value[0].split(":")[0] for value in card.values] == ["undisturbed", "disturbed"]
    assert card.values[0][1:] == ("25.0 %", f"[25.0 to 25.0], n = {len(SEEDS)}")
    mine = rows[(rows["robot"] == "pickers") & (rows["policy"] == "gp-word")]
    assert card.values[1][1] == f"{100 * mine['contact_final'].mean():.1f} %"
    assert f"], n = {len(SEEDS)}; regained +" in card.values[1][2]


@pytest.mark.parametrize("n", [1, 3, 6, 40])
def test_every_value_of_a_box_plot_is_a_mark_that_none_hides(n):
    """Equal values lie side by side; marks are the only elements of a plot that are outlined in the card's colour."""
    figure = charts.box_plots({"final": {"gp-word": np.full(n, 0.97), "other": np.full(n, 0.5)}})
    (panel,) = figure.panels
    outlined = r"<use href=\"#\w+\" x=\"([\d.]+)\" y=\"([\d.]+)\" style=\"[^\"]*stroke: var\(--card\)"
    marks = re.findall(outlined, panel)
    assert len(set(marks)) == 2 * n
    assert ("var(--series-1); opacity: 0.2" in panel) == (n >= charts.MIN_BOX)
    assert figure.alt == "contact portion (%), medians. final: gp-word 97.0, other 50.0."
    assert [key.name for key in figure.legend] == ["gp-word", "other"]


def test_options_add_the_thesis_and_sections(batch, pickers):
    class Thesis:
        rows = pickers.rows.assign(disturbance="thesis")
        episode = staticmethod(batch.episode)

    extra = Section(id="field", title="Fields", blocks=(Text(lines=("x",)),))
    with EpisodeRenderer() as renderer:
        options = PageOptions(thesis_tables=True, sections=(extra,))
        page = evaluation_page(Thesis(), renderer, options, title="t")
        undisturbed = Thesis()
        undisturbed.rows = batch.rows[batch.rows["robot"] == "hanger"]
        other = evaluation_page(undisturbed, renderer, options, title="t")
    assert extra in page.sections
    for shown, cited in ((page, 6), (other, 2)):
        (table,) = (b.table for b in shown.sections[0].blocks if isinstance(b, TableBlock) and b.table.cited)
        assert len(table.cited) == cited


def test_the_table_holds_the_numbers_of_the_rows(batch):
    rows = batch.rows[(batch.rows["robot"] == "pickers") & (batch.rows["disturbance"] == "push")]
    table = group_table(rows)
    lines = {line[0]: dict(zip(table.header, line, strict=True)) for line in table.rows}
    mine = rows[rows["policy"] == "gp-word"]
    regained = 100 * (mine["contact_final"] - mine["contact_disturbed"]).mean()
    assert lines["gp-word"]["final [95\u00a0%\u00a0CI]"].startswith(f"{100 * mine['contact_final'].mean():.1f} % [")
    assert lines["gp-word"]["regained, points [95\u00a0%\u00a0CI]"].startswith(f"{regained:+.1f} [")
    crashed = lines["gp-baseline+drag-rule"]  # the crashed one counts, but has no numbers
    assert (crashed["n"], crashed["lost"]) == (str(len(SEEDS)), "1")
    assert f"of {len(SEEDS)}" in crashed["flat at the end"]
    cells = dict(zip(episode_table(mine).header, episode_table(mine).rows[0], strict=True))
    assert cells["steps"] == str(int(mine["steps"].iloc[0]))
    assert cells["final"] == f"{100 * mine['contact_final'].iloc[0]:.1f} %"


def test_a_crash_is_shown_with_its_reason_and_is_no_success(batch, page):
    text = page.read_text(encoding="utf-8")
    assert "1 of 36 episodes crashed" in text
    assert "its process ended with status -11" in text
    assert not with_measures(batch.rows)["success"].iloc[-1]
    assert failures(batch.rows).iloc[-1] == "crashed"


def test_examples_are_the_best_the_typical_and_the_worst_once_each(batch):
    rows = batch.rows[(batch.rows["policy"] == "gp-word") & (batch.rows["disturbance"] == "push")]
    picks = dict(example_rows(rows))
    finals = rows["contact_final"]
    assert picks["best"]["contact_final"] == finals.max()
    assert picks["worst"]["contact_final"] == finals.min()
    assert finals.quantile(0.4) <= picks["typical"]["contact_final"] <= finals.quantile(0.6)
    assert [name for name, _ in example_rows(rows[:1])] == ["worst"]
    assert [name for name, _ in example_rows(rows[:0])] == []


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
    table = Table(("a", "b"), (("x | y", "1"),))
    assert table_markdown(table).splitlines()[-1] == "| x \\| y | 1 |"
    text = markdown(content)
    assert text.startswith("# An evaluation of made-up <episodes>\n")
    assert text.count("| --- |") == 2 * len(CONDITIONS) + 1


@needs_chromium
@pytest.mark.parametrize("width", [1280, 800, 390])
def test_a_browser_shows_all_of_it(page, tmp_path, width):
    """Nothing reaches beyond the window, no picture is broken, and no table is scrolled but at 800."""
    found = measured(page, tmp_path, width)
    assert (found["overflow"], found["wide"], found["broken"]) == (0, 0, 0)
    assert width == 800 or found["cut"] == 0
    image = screenshot(page, tmp_path, width)
    assert image.shape[:2] == (1600, width)
    assert image.std() > 20
