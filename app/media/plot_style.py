"""Style of every Matplotlib figure, and figures as PNG or SVG.

People with any kind of colour blindness can tell the colours apart, which also differ in luminance.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

matplotlib.use("Agg")

INK = "#1d2733"
MUTED = "#52606d"
LINE = "#e3e8ed"
ALERT = "#b3372b"
"""Disturbances, and ends of demonstrations."""
CARD = "#fefefe"
"""Ground under a figure."""
SERIES = ("#e16c10", "#3b51d3", "#651911", "#29a1c1", "#3b2279", "#884f61")
"""Colours of things that are compared."""
VARIABLES: Mapping[str, str] = {
    INK: "ink", MUTED: "muted", LINE: "line", ALERT: "bad", CARD: "card",
    **{color: f"series-{k}" for k, color in enumerate(SERIES)},
}  # fmt: skip
"""CSS variable of a page that stands for each colour in an SVG."""
DPI = 160
STYLE: Any = {
    "font.size": 9,
    "font.family": "DejaVu Sans",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titlecolor": INK,
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "grid.color": LINE,
    "legend.frameon": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "layflat",
}
_FILE_ONLY = re.compile(
    r"^.*?(?=<svg)|<metadata>.*?</metadata>|<defs>\s*<style.*?</style>\s*</defs>"
    r"| (?:xmlns(?::xlink)?|version|(?:width|height)(?==\"[\d.]+pt\"))=\"[^\"]*\""
    r"|(?<=<g) id=\"[a-zA-Z][\w.]*_\d+\"|font-family: [^;\"]*; ?",
    re.DOTALL,
)
_DECIMALS = re.compile(r"(\.\d\d)\d+")


def legend_below(axis: Axes, columns: int) -> None:
    """Add a legend under the axis, where it covers nothing."""
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=columns, fontsize=8)


@contextmanager
def styled_figure(width: float, height: float) -> Iterator[Figure]:
    """Make a figure of a size in inches, in the style above."""
    with matplotlib.rc_context(STYLE):
        yield Figure(figsize=(width, height), layout="constrained")


def png_bytes(figure: Figure) -> bytes:
    """Return the figure as a PNG file's content; the same figure gives the same bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    return buffer.getvalue()


def svg_text(figure: Figure) -> str:
    """Return the figure as an SVG element for a page that sets the VARIABLES and the font."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    return themed(buffer.getvalue())


def themed(svg: str) -> str:
    """Replace fixed colours and fonts of an SVG by the page's own, and leave out what only a file needs."""
    svg = _DECIMALS.sub(r"\1", _FILE_ONLY.sub("", svg)).replace("xlink:href", "href")
    for color, name in VARIABLES.items():
        svg = svg.replace(color, f"var(--{name})")
    return "\n".join(line.strip() for line in svg.splitlines() if line.strip())
