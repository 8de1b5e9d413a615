"""Style of every Matplotlib figure, and figures as PNG bytes."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib
from matplotlib.figure import Figure

matplotlib.use("Agg")

INK = "#1d2733"
MUTED = "#667382"
ALERT = "#b3372b"
"""Disturbances, and ends of demonstrations."""
DPI = 160
STYLE: Any = {
    "font.size": 9,
    "font.family": "DejaVu Sans",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#b6c0cb",
    "axes.labelcolor": INK,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titlecolor": INK,
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "grid.color": "#e8ecf0",
    "legend.frameon": False,
}
BOXED_LEGEND: Any = {"frameon": True, "facecolor": "white", "edgecolor": "none", "framealpha": 0.85, "fontsize": 8}
"""Keyword arguments of a legend that lies over the curves."""


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
