"""Colours that everyone can tell apart, and an SVG that follows its page."""

from __future__ import annotations

import re
from importlib import resources
from itertools import combinations

import numpy as np
import pytest

from layflat.app.media.plot_style import ALERT, CARD, INK, SERIES, VARIABLES, styled_figure, svg_text

VISIONS = {
    "usual": np.eye(3),
    "protanopia": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "deuteranopia": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    "tritanopia": [[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]],
}
"""Machado, Oliveira and Fernandes 2009, severity 1, on linear RGB."""
TO_LMS = np.array([[0.4122, 0.5363, 0.0514], [0.2119, 0.6807, 0.1074], [0.0883, 0.2817, 0.6300]])
TO_OKLAB = np.array([[0.2105, 0.7936, -0.0041], [1.9780, -2.4286, 0.4506], [0.0259, 0.7828, -0.8087]])


def linear(color):
    values = np.array([int(color[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def luminance(color):
    return float(linear(color) @ [0.2126, 0.7152, 0.0722])


def contrast(a, b):
    low, high = sorted([luminance(a), luminance(b)])
    return (high + 0.05) / (low + 0.05)


def distance(a, b, vision):
    """Of two colours in Oklab, as seen."""
    seen = [np.clip(np.asarray(VISIONS[vision]) @ linear(color), 0, 1) for color in (a, b)]
    one, other = (TO_OKLAB @ np.cbrt(TO_LMS @ color) for color in seen)
    return float(np.linalg.norm(one - other))


def page_colors():
    """Variables of the page's style sheet: light, and dark."""
    style = resources.files("layflat.app.report").joinpath("templates/style.css.j2").read_text(encoding="utf-8")
    light, dark = re.findall(r":root \{(.*?)\}", style, re.DOTALL)
    themes = [dict(re.findall(r"--([\w-]+): (#[0-9a-f]+)", part)) for part in (light, dark)]
    return {name: {k: c if len(c) == 7 else "#" + c[1] * 2 + c[2] * 2 + c[3] * 2 for k, c in theme.items()}
            for name, theme in zip(("light", "dark"), themes, strict=True)}  # fmt: skip


@pytest.mark.parametrize("vision", VISIONS)
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_colours_of_a_chart_differ_for_every_eye(theme, vision):
    colors = page_colors()[theme]
    series = [colors[f"series-{k}"] for k in range(len(SERIES))]
    assert theme == "dark" or series == list(SERIES)
    assert min(distance(a, b, vision) for a, b in combinations(series, 2)) > 0.13
    assert distance(colors["good"], colors["bad"], vision) > 0.2


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_colours_stand_out_from_the_page(theme):
    colors = page_colors()[theme]
    for ground in ("card", "ground"):
        assert all(contrast(colors[text], colors[ground]) >= 4.5 for text in ("ink", "muted", "link", "bad", "good"))
    assert all(contrast(colors[f"series-{k}"], colors["card"]) >= 2.9 for k in range(len(SERIES)))
    assert contrast(colors["good"], colors["bad"]) > 1.2, "they differ in luminance, not only in hue"
    assert set(VARIABLES.values()) <= set(colors)


def test_an_svg_has_the_colours_and_the_font_of_its_page():
    with styled_figure(3, 2) as figure:
        axis = figure.subplots()
        axis.plot([0, 1], [2, 3], "o-", color=SERIES[2], markeredgecolor=CARD)
        axis.axvspan(0.2, 0.4, color=ALERT)
        axis.set(title="a <title>", xlabel="x")
        axis.grid()
        svg = svg_text(figure)
    assert svg.startswith('<svg viewBox="')
    assert not re.search(r"#[0-9a-f]{6}\b(?!\")|font-family|https?:|<metadata|<style", svg)
    assert all(f"var(--{VARIABLES[color]})" in svg for color in (SERIES[2], CARD, ALERT, INK))
    assert "a &lt;title&gt;</text>" in svg
    assert re.search(r"<clipPath[^>]*>\s*<rect [^>]*width=", svg), "a clip without a size hides everything"
