"""Parts of pages: sentences, tables, pictures, curves, and changes that are only sent where something changes."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping, Sequence
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

COLORS: Mapping[Level, str] = {
    "info": "inherit", "success": "light-dark(#0f766e,#5eead4)", "warning": "light-dark(#b45309,#fbbf24)",
    "error": "light-dark(#b42318,#ff9a8d)",
}  # fmt: skip
"""Text colors with a contrast of at least 4.5:1 in the light and the dark theme; the words say it as well."""
SIGNS: Mapping[Level, str] = {"info": "", "success": "✓ ", "warning": "⚠ ", "error": "⚠ "}
LINES = ("light-dark(#0f766e,#5eead4)", "light-dark(#6d5bd0,#b4a7ff)")
"""Color of the first and of the second episode."""
WIDE, HIGH, LEFT, RIGHT, TOP, BOTTOM = 300, 104, 26, 294, 16, 90
"""Size of a plot, and where its axes are."""
_PINHOLE = default_pinhole()


def put(handle: Any, **values: Any) -> None:
    """Set properties of a part of the page, where they change: each change is a message."""
    for name, value in values.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)


def sentence(text: str, level: Level = "info") -> str:
    """Return a sentence as HTML, with its sign and color; empty for an empty text."""
    role = "alert" if level in ("warning", "error") else "status"
    style = f"margin:0.3em 0.9em;font-size:0.9em;overflow-wrap:anywhere;color:{COLORS[level]}"
    return f'<p role="{role}" style="{style}">{SIGNS[level]}{html.escape(text)}</p>' if text else ""


def facts(rows: Mapping[str, str]) -> str:
    """Return names and values as an HTML table."""
    style = 'scope="row" style="text-align:left;font-weight:400;opacity:.75;padding-right:1em;white-space:nowrap"'
    cells = "".join(
        f"<tr><th {style}>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>" for name, value in rows.items()
    )
    return f'<table style="margin:0.3em 0.9em;font-size:0.9em;border-spacing:0 0.15em">{cells}</table>'


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table as HTML; it scrolls within the panel where it is too wide."""
    cell = 'style="text-align:left;padding:0.15em 0.7em 0.15em 0"'
    head = "".join(f'<th scope="col" {cell}>{html.escape(name)}</th>' for name in header)
    body = "".join("<tr>" + "".join(f"<td {cell}>{html.escape(one)}</td>" for one in row) + "</tr>" for row in rows)
    style = "overflow-x:auto;margin:0.3em 0.9em;font-size:0.85em"
    return f'<div tabindex="0" style="{style}"><table><tr>{head}</tr>{body}</table></div>'


def output(lines: Sequence[str]) -> str:
    """Return printed lines as HTML."""
    style = "margin:0.3em 0.9em;font-size:0.75em;max-height:22em;overflow:auto;white-space:pre"
    return f'<pre tabindex="0" style="{style}">{html.escape(chr(10).join(lines))}</pre>' if lines else ""


def media(content: bytes, kind: str, alt: str = "") -> str:
    """Return a picture, or a film that plays in place, as HTML; ``kind`` is its media type."""
    source = f'style="max-width:100%" src="data:{kind};base64,{base64.b64encode(content).decode()}"'
    if kind.startswith("video"):
        return f"<video controls loop muted autoplay {source}></video>"
    return f'<img alt="{html.escape(alt)}" {source}>'


def mark(name: str) -> str:
    """Return an invisible mark as HTML; `write` finds the field that follows it."""
    return f'<span class="lf-{name}"></span>'


def write(name: str, value: str) -> str:
    """Return a script that writes a JavaScript value into the field behind a mark, as typing would."""
    return (
        f"const f=document.querySelector('div:has(> .lf-{name}) + div input:not([type=hidden])');"
        f"Object.getOwnPropertyDescriptor(HTMLInputElement.prototype,'value').set.call(f,{value});"
        "f.dispatchEvent(new Event('input',{bubbles:true}))"
    )


@lru_cache(maxsize=2)  # Several viewers show the same frame.
def camera_image(frame: SimulationFrame) -> NDArray[np.uint8]:
    """Return the camera's picture with contact and WORD drawn on it; a plain one where it has seen nothing."""
    if frame.rgb is None or frame.cloth_state is None:
        return blank()
    return np.asarray(draw_cloth_state(frame.rgb, frame.cloth_state, frame.pinhole, scale=1), dtype=np.uint8)


def blank() -> NDArray[np.uint8]:
    """Return the picture of a camera that has seen nothing yet."""
    return np.full((_PINHOLE.height // 4, _PINHOLE.width // 4, 3), 235, np.uint8)


class Curves:
    """Contact and WORD of one episode, or of two on one time line."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._plots = gui.add_html("")

    def show(self, *series: TimeSeries, at_s: float | None = None, step_s: float | None = None) -> None:
        """Show episodes, each as one line, and a moment; ``step_s``: a click writes its step behind the mark "step"."""
        end_s = max((one.time_s[-1] for one in series if one.time_s), default=0.0)
        if not end_s:
            return
        click = ""
        if step_s is not None:
            x = f"(event.clientX-r.left)/r.width*{WIDE}-{LEFT}"
            step = f"Math.round(Math.min(Math.max(({x})/{RIGHT - LEFT},0),1)*{end_s / step_s:.3f})"
            script = f"const r=this.getBoundingClientRect();{write('step', step)}"
            # While an episode plays, the picture may be another one when the button goes up.
            click = f'onpointerdown="{html.escape(script)}" style="cursor:crosshair"'
        contact = [(one.time_s, [100 * value for value in one.contact]) for one in series]
        word = [(one.time_s, one.angle_deg) for one in series]
        plots = _plot("contact (%)", contact, (0, 50, 100), end_s, at_s, 'stroke-width="1.6"', click)
        plots += _plot("WORD (°)", word, (-90, 0, 90), end_s, at_s, 'stroke-width="3" stroke-linecap="round"', click)
        put(self._plots, content=f'<div style="padding:0 4px">{plots}</div>')


def _plot(
    title: str, lines: Sequence[tuple[Sequence[float], Sequence[float]]], ticks: tuple[float, float, float],
    end_s: float, at_s: float | None, style: str, click: str,
) -> str:  # fmt: skip
    """Return lines, or points where ends are round, over time as SVG."""

    def x(time_s: float) -> float:
        return LEFT + (RIGHT - LEFT) * time_s / end_s

    def y(value: float) -> float:
        return BOTTOM - (BOTTOM - TOP) * (value - ticks[0]) / (ticks[2] - ticks[0])

    parts = [f'<text x="{LEFT}" y="11">{title}</text><text x="{RIGHT}" y="102" text-anchor="end">{end_s:.1f} s</text>']
    parts += [f'<text x="{LEFT}" y="102">0</text>']
    for tick in ticks:
        parts.append(f'<text x="{LEFT - 3}" y="{y(tick) + 3:.0f}" text-anchor="end">{tick:g}</text>')
        parts.append(f'<path d="M{LEFT} {y(tick):.0f}H{RIGHT}" stroke="currentColor" opacity=".25"/>')
    for (times, values), color in zip(lines, LINES, strict=False):
        every, points, pen = max(len(times) // (RIGHT - LEFT), 1), [], "M"
        for time_s, value in zip(times[::every], values[::every], strict=False):
            if np.isnan(value):
                pen = "M"
                continue
            points.append(f"{pen}{x(time_s):.1f} {y(value):.1f}" + ("h0" if "round" in style else ""))
            pen = "M" if "round" in style else "L"
        parts.append(f'<path d="{"".join(points)}" fill="none" stroke="{color}" {style}/>')
    if at_s is not None:
        parts.append(f'<path d="M{x(min(at_s, end_s)):.1f} {TOP}V{BOTTOM}" stroke="currentColor" class="lf-now"/>')
    return (
        f'<svg role="img" aria-label="{title} over time" viewBox="0 0 {WIDE} {HIGH}" width="100%" font-size="9"'
        f' fill="currentColor" {click}><rect width="{WIDE}" height="{HIGH}" opacity="0"/>{"".join(parts)}</svg>'
    )


class Monitor:
    """The camera's picture and the curves, beside the scene."""

    WIDTH_PX = 300
    PICTURE_S = 0.2
    """Shortest time between two pictures."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._panel = gui.add_panel(visible=False)
        with self._panel.add_tab("Camera"):
            self._picture = gui.add_image(blank(), format="jpeg")
            self._curves = Curves(gui)
        self._panel.dock_left()
        self._panel.set_width(self.WIDTH_PX)
        self._panel.expand()  # On a phone, too.
        self._frame: SimulationFrame | None = None
        self._due_s = 0.0

    def show(self, now_s: float, frame: SimulationFrame | None, *series: TimeSeries, **options: float | None) -> None:
        """Show a frame and its curves, with the options of `Curves.show`; hide the panel where there is no frame."""
        put(self._panel, visible=frame is not None)
        if frame is None or frame is self._frame or now_s < self._due_s:
            return
        self._frame, self._due_s = frame, now_s + self.PICTURE_S
        self._picture.image = camera_image(frame)
        self._curves.show(*series, **options)
