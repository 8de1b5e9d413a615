"""The page of an evaluation in a browser: on a phone, in dark mode, and on paper."""

from __future__ import annotations

import unicodedata
from itertools import pairwise

import pytest

from layflat.app.report.blocks import Page, Section, Table, TableBlock
from layflat.app.report.page import write_page
from layflat.tests.browser import CHROMIUM, needs_chromium

pytestmark = needs_chromium
playwright = pytest.importorskip("playwright.sync_api", reason="no playwright here")

MIN_CONTRAST = 4.5
"""Of text, by WCAG 2.2 AA."""
OUTSIDE = """() => {
  document.querySelectorAll('details').forEach(e => e.open = true);
  const width = document.documentElement.clientWidth, found = [];
  for (const e of document.querySelectorAll('body *')) {
    const box = e.getBoundingClientRect();
    if (box.width && !e.closest('svg') && (box.right > width + 1 || box.left < -1)) found.push(e.outerHTML);
    const card = e.closest('.card');
    if (['VIDEO', 'IMG', 'TABLE'].includes(e.tagName) && card && box.right > card.getBoundingClientRect().right)
      found.push('out of its card: ' + e.outerHTML.slice(0, 80));
  }
  return [document.documentElement.scrollWidth - width, found];
}"""
CONTRASTS = """() => {
  const rgb = text => text.match(/[\\d.]+/g).map(Number);
  const light = c => c.slice(0, 3).map(v => v / 255).map(v => v <= .04045 ? v / 12.92 : ((v + .055) / 1.055) ** 2.4)
    .reduce((sum, v, k) => sum + v * [.2126, .7152, .0722][k], 0);
  const found = [];
  for (const e of document.querySelectorAll('body *')) {
    if (![...e.childNodes].some(n => n.nodeType === 3 && n.data.trim()) || !e.getClientRects().length) continue;
    let ground = e;
    while (ground && rgb(getComputedStyle(ground).backgroundColor)[3] === 0) ground = ground.parentElement;
    const style = getComputedStyle(e);
    const pair = [rgb(e.closest('svg') ? style.fill : style.color),
      ground ? rgb(getComputedStyle(ground).backgroundColor) : [255, 255, 255]].map(light).sort((a, b) => a - b);
    found.push([(pair[1] + .05) / (pair[0] + .05), e.textContent.trim().slice(0, 40)]);
  }
  return found;
}"""


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as driver:
        yield driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])


def shown(browser, path, **options):
    page = browser.new_page(**options)
    page.goto(path.as_uri())
    return page


@pytest.mark.parametrize("width", [320, 390, 1280])
def test_nothing_is_outside_of_the_page_or_of_its_card(browser, page, width):
    assert shown(browser, page, viewport={"width": width, "height": 800}).evaluate(OUTSIDE) == [0, []]


@pytest.mark.parametrize("width", [390, 1280])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_and_axes_have_enough_contrast(browser, page, scheme, width):
    view = shown(browser, page, color_scheme=scheme, viewport={"width": width, "height": 800})
    ground = view.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (max(map(int, ground[4:-1].split(","))) < 60) == (scheme == "dark")
    contrasts = view.evaluate(CONTRASTS)
    assert len(contrasts) > 300
    assert [found for found in contrasts if found[0] < MIN_CONTRAST] == []


def test_links_of_the_head_are_apart_and_wrap(browser, page):
    view = shown(browser, page, viewport={"width": 390, "height": 800})
    boxes = view.evaluate("[...document.querySelectorAll('nav a')].map(e => e.getBoundingClientRect().toJSON())")
    for a, b in pairwise(boxes):
        assert b["left"] - a["right"] >= 12 or b["top"] >= a["bottom"]
    assert len({box["top"] for box in boxes}) > 1


def test_a_link_of_a_row_shows_its_episode(browser, page):
    view = shown(browser, page, viewport={"width": 1280, "height": 800})
    view.click("summary:has-text('36 episodes')")
    link = view.locator("td.episode a").first
    link.click()
    target = link.get_attribute("href").removeprefix("#")
    box = view.locator(f"[id='{target}']").bounding_box()
    assert -1 <= box["y"] < 800


def test_paper_shows_pictures_of_films_and_light_colours(browser, page):
    view = shown(browser, page, color_scheme="dark")
    view.emulate_media(media="print")
    assert view.locator("video:visible").count() == 0
    assert view.locator(".poster:visible").count() == 2
    assert [found for found in view.evaluate(CONTRASTS) if found[0] < MIN_CONTRAST] == []


def texts(pypdf, path):
    """Text of each sheet, on one line and without ligatures."""
    sheets = pypdf.PdfReader(path).pages
    return [" ".join(unicodedata.normalize("NFKC", sheet.extract_text()).split()) for sheet in sheets]


def test_a_printed_page_has_every_column_and_repeats_heads(browser, page, tmp_path):
    pypdf = pytest.importorskip("pypdf")
    shown(browser, page, color_scheme="dark").pdf(path=tmp_path / "page.pdf", format="A4")
    sheets = texts(pypdf, tmp_path / "page.pdf")
    text = "\n".join(sheets)
    assert 5 <= len(sheets) <= 16
    assert text.count("flat at the end") >= 2
    assert "stopped by" in text.partition("Every episode")[2], "short lists are printed unfolded"

    header = ("name", *(f"column {k}" for k in range(12)), "the last")
    rows = tuple((f"row-{k:03d}", *["100.0 %"] * 12, f"end{k:03d}") for k in range(120))
    block = TableBlock(table=Table(header, rows))
    write_page(tmp_path / "t.html", Page(title="t", lead="", sections=(Section(id="s", title="s", blocks=(block,)),)))
    shown(browser, tmp_path / "t.html").pdf(path=tmp_path / "t.pdf", format="A4")
    sheets = texts(pypdf, tmp_path / "t.pdf")
    assert len(sheets) > 1
    for k in range(120):
        assert [f"end{k:03d}" in sheet for sheet in sheets] == [f"row-{k:03d}" in sheet for sheet in sheets]
        assert sum(f"row-{k:03d}" in sheet for sheet in sheets) == 1
    assert all("the last" in sheet for sheet in sheets if "row-" in sheet)
