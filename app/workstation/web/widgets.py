"""Parts of pages: sentences, curves, pictures, and changes that are only sent where something changes."""

from __future__ import annotations

import base64
import html
from functools import lru_cache
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.session.status import Level
from layflat.app.workstation.time_series import TimeSeries
from layflat.perception.overlay import draw_cloth_state
from layflat.sim.camera.camera import default_pinhole

COLORS: dict[Level, str] = {"info": "inherit", "success": "#0f766e", "warning": "#b45309", "error": "#b42318"}
"""Text colours with a contrast of at least 4.5:1 on white; the words say it as well."""
SIGNS: dict[Level, str] = {"info": "", "success": "✓ ", "warning": "⚠ ", "error": "⚠ "}
CONTACT_COLOR, WORD_COLOR, OTHER_COLOR = "#0f766e", "#c2571a", "#6d5bd0"
CURVE_PX = 130
CURVE_POINTS = 400
_PINHOLE = default_pinhole()


def put(handle: Any, **values: Any) -> None:
    """Set properties of a part of the page, where they change: each change is a message."""
    for name, value in values.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)


def sentence(text: str, level: Level = "info") -> str:
    """Return a sentence as HTML, with its sign and colour; empty for an empty text."""
    if not text:
        return ""
    role = "alert" if level in ("warning", "error") else "status"
    return (
        f'<p role="{role}" style="margin:0.3em 0.9em;font-size:0.9em;overflow-wrap:anywhere;color:{COLORS[level]}">'
        f"{SIGNS[level]}{html.escape(text)}</p>"
    )


def facts(rows: dict[str, str]) -> str:
    """Return names and values as an HTML table."""
    cells = "".join(
        f'<tr><th scope="row" style="text-align:left;font-weight:400;opacity:.75;padding-right:1em;white-space:nowrap">'
        f"{html.escape(name)}</th><td>{html.escape(value)}</td></tr>"
        for name, value in rows.items()
    )
    return f'<table style="margin:0.3em 0.9em;font-size:0.9em;border-spacing:0 0.15em">{cells}</table>'


def output(lines: list[str]) -> str:
    """Return printed lines as HTML."""
    text = html.escape("\n".join(lines))
    style = "margin:0.3em 0.9em;font-size:0.75em;max-height:22em;overflow:auto;white-space:pre"
    return f'<pre tabindex="0" style="{style}">{text}</pre>' if text else ""


def picture(png: bytes, kind: str = "image/png", alt: str = "") -> str:
    """Return an image file as HTML."""
    data = base64.b64encode(png).decode()
    return f'<img alt="{html.escape(alt)}" style="max-width:100%" src="data:{kind};base64,{data}">'


def film(webm: bytes) -> str:
    """Return a video as HTML that plays in place."""
    data = base64.b64encode(webm).decode()
    return f'<video controls loop muted autoplay style="max-width:100%" src="data:video/webm;base64,{data}"></video>'


@lru_cache(maxsize=2)  # Several viewers show the same frame.
def camera_image(frame: SimulationFrame) -> NDArray[np.uint8] | None:
    """Return the camera's picture with contact and WORD drawn on it, or None where there is none."""
    if frame.rgb is None or frame.cloth_state is None:
        return None
    return np.asarray(draw_cloth_state(frame.rgb, frame.cloth_state, _PINHOLE, scale=1), dtype=np.uint8)


class Curves:
    """Contact and WORD over time."""

    def __init__(self, gui: viser.GuiApi, names: tuple[str, ...] = ("",)) -> None:
        """Make the plots, with a line for each of ``names``."""
        colors = (CONTACT_COLOR, OTHER_COLOR)
        empty = tuple(np.zeros(1) for _ in range(len(names) + 1))
        self._n = len(names)

        def plot(label: str, colors: tuple[str, ...], low: float, high: float, points: bool) -> viser.GuiUplotHandle:
            series = [viser.uplot.Series(label="time (s)")]
            for name, color in zip(names, colors, strict=False):
                series.append(
                    viser.uplot.Series(
                        label=f"{label} {name}".strip(), stroke=color, width=0 if points else 2,
                        points={"show": points, "size": 4, "fill": color},
                    )
                )  # fmt: skip
            return gui.add_uplot(
                empty,
                tuple(series),
                scales={"x": viser.uplot.Scale(time=False), "y": viser.uplot.Scale(range=(low, high))},
                axes=(viser.uplot.Axis(size=26), viser.uplot.Axis(size=40)),
                height=CURVE_PX,
                title=label,
                padding=(6, 16, 0, 0),
                legend=viser.uplot.Legend(show=False),
            )

        self._contact = plot("contact (%)", colors, 0.0, 100.0, points=False)
        self._word = plot("WORD (°)", (WORD_COLOR, OTHER_COLOR), -90.0, 90.0, points=True)
        self._shown: tuple[object, ...] = ()

    def show(self, *series: TimeSeries) -> None:
        """Show episodes, each as one line."""
        shown = tuple((id(one), one.episode, len(one.time_s)) for one in series)
        if shown == self._shown or not any(one.time_s for one in series):
            return
        self._shown = shown
        times = np.unique(np.concatenate([np.array(one.time_s) for one in series]))
        times = times[:: max(len(times) // CURVE_POINTS, 1)]
        times = times if len(times) > 1 else np.array([times[0], times[0] + 0.1])
        padded = [*series, *[TimeSeries()] * (self._n - len(series))]
        self._contact.data = (times, *(100 * _at(times, one, one.contact) for one in padded))
        self._word.data = (times, *(_at(times, one, one.angle_deg) for one in padded))


def _at(times: NDArray[np.float64], series: TimeSeries, values: list[float]) -> NDArray[np.float64]:
    """Return the newest of ``values`` at each time; NaN before the first and after the last."""
    if not series.time_s:
        return np.full(len(times), np.nan)
    known = np.array(series.time_s)
    found = np.array(values)[np.clip(np.searchsorted(known, times + 1e-6, side="right") - 1, 0, None)]
    return np.where((times < known[0] - 1e-6) | (times > known[-1] + 1e-6), np.nan, found)


def blank() -> NDArray[np.uint8]:
    """Return the picture of a camera that has seen nothing yet."""
    return np.full((_PINHOLE.height // 4, _PINHOLE.width // 4, 3), 235, np.uint8)


def table(header: list[str], rows: list[list[str]]) -> str:
    """Return a table as HTML; it scrolls within the panel where it is too wide."""
    cell = 'style="text-align:left;padding:0.15em 0.7em 0.15em 0"'
    head = "".join(f'<th scope="col" {cell}>{html.escape(name)}</th>' for name in header)
    body = "".join("<tr>" + "".join(f"<td {cell}>{html.escape(one)}</td>" for one in row) + "</tr>" for row in rows)
    return (
        f'<div tabindex="0" style="overflow-x:auto;margin:0.3em 0.9em;font-size:0.85em">'
        f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )
