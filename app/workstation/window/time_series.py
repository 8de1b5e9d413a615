"""Curves of the contact portion and WORD."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pygame
from numpy.typing import ArrayLike, NDArray

from layflat.app.workstation.time_series import TimeSeries
from layflat.app.workstation.window import style

MIN_SPAN_S = 10.0
"""Shortest time axis."""
_PHASE_TINT = {"disturb": (74, 40, 44), "repair": (34, 50, 66)}
"""Background of a phase; placing has that of the card."""
HUMAN_PX = 6
"""Height of the band below the curves where a person was in control."""
_SHIFT = 4


def draw_contact(surface: pygame.Surface, series: TimeSeries, now_s: float | None = None) -> None:
    """Draw the contact portion on a card; ``now_s`` marks a moment (replay)."""
    value = _value_at(series.time_s, series.contact, now_s)
    text = "" if value is None else f"{100 * value:.0f} %"
    plot, canvas = _start_plot(surface, series, "Contact", text, style.CONTACT)
    _draw_grid(canvas, (0.0, 0.5, 1.0))
    if series.time_s:
        height = plot.height
        line = np.stack([_x(series, plot.width), _y(np.clip(series.contact, 0, 1), (0.0, 1.0), height)], axis=1)
        shaded = np.vstack([line, [line[-1, 0], height], [line[0, 0], height]])
        tint = canvas.copy()
        cv2.fillPoly(tint, [_fixed(shaded)], style.CONTACT, cv2.LINE_AA, _SHIFT)
        cv2.addWeighted(tint, 0.16, canvas, 0.84, 0, canvas)
        cv2.polylines(canvas, [_fixed(line)], False, style.CONTACT, 2, cv2.LINE_AA, _SHIFT)
    _finish_plot(surface, canvas, plot, series, now_s, ("0", "50", "100"))


def draw_word(surface: pygame.Surface, series: TimeSeries, now_s: float | None = None) -> None:
    """Draw WORD's angle to the robot's front on a card."""
    angle = _value_at(series.time_s, series.angle_deg, now_s)
    text = "" if angle is None else "none" if math.isnan(angle) else f"{round(angle) or 0:+d}°"
    plot, canvas = _start_plot(surface, series, "WORD", text, style.WORD)
    _draw_grid(canvas, (-90.0, 0.0, 90.0))
    angles = np.array(series.angle_deg)
    known = np.isfinite(angles)
    if known.any():
        places = np.stack([_x(series, plot.width)[known], _y(angles[known], (-90.0, 90.0), plot.height)], axis=1)
        for x, y in _fixed(places).tolist():
            cv2.circle(canvas, (x, y), int(2.2 * 2**_SHIFT), style.WORD, -1, cv2.LINE_AA, _SHIFT)
    _finish_plot(surface, canvas, plot, series, now_s, ("-90°", "0°", "90°"))


def _start_plot(
    surface: pygame.Surface, series: TimeSeries, title: str, value: str, color: style.Color
) -> tuple[pygame.Rect, NDArray[np.uint8]]:
    """Draw the card and its heading; return the area of the curve, and its picture with tinted phases."""
    surface.fill(style.BACKGROUND)
    area = surface.get_rect()
    style.draw_card(surface, area)
    style.draw_text(surface, title, (12, 7), 13, style.QUIET)
    style.draw_text(surface, value, (area.width - 12, 3), 18, color, face=style.BOLD, align="right")
    plot = pygame.Rect(42, 34, area.width - 42 - 14, max(area.height - 34 - 24, 10))
    canvas = np.full((plot.height, plot.width, 3), style.CARD, np.uint8)
    x = _x(series, plot.width)
    for k, phase in enumerate(series.phase):
        if phase in _PHASE_TINT:
            canvas[:, int(x[k - 1]) if k else 0 : int(x[k]) + 1] = _PHASE_TINT[phase]
    return plot, canvas


def _draw_grid(canvas: NDArray[np.uint8], levels: tuple[float, ...]) -> None:
    height, width = canvas.shape[:2]
    for y in np.rint(_y(levels, (levels[0], levels[-1]), height)).astype(int).tolist():
        cv2.line(canvas, (0, y), (width, y), style.LINE, 1)


def _finish_plot(
    surface: pygame.Surface,
    canvas: NDArray[np.uint8],
    plot: pygame.Rect,
    series: TimeSeries,
    now_s: float | None,
    labels: tuple[str, ...],
) -> None:
    """Draw the band of a person in control, the marked moment, and the axes, whose ``labels`` go from low to high."""
    places = _x(series, plot.width)
    for k, human in enumerate(series.human):
        if human and k:
            canvas[-HUMAN_PX:, int(places[k - 1]) : int(places[k]) + 1] = style.HUMAN
    span_s = _span_s(series)
    if now_s is not None:
        x = int(now_s / span_s * (plot.width - 1))
        cv2.line(canvas, (x, 0), (x, plot.height), style.TEXT, 1)
    surface.blit(style.make_picture(canvas), plot)
    heights = np.rint(_y(range(len(labels)), (0, len(labels) - 1), plot.height)).astype(int).tolist()
    for label, y in zip(labels, heights, strict=True):
        style.draw_text(surface, label, (plot.left - 4, plot.top + y - 8), 11, style.FAINT, align="right")
    bottom = surface.get_rect().bottom - 21
    style.draw_text(surface, "0", (plot.left - 3, bottom), 11, style.FAINT)
    style.draw_text(surface, f"{span_s:.0f} s", (plot.right, bottom), 11, style.FAINT, align="right")


def _span_s(series: TimeSeries) -> float:
    return max(MIN_SPAN_S, 5.0 * math.ceil((series.time_s[-1] if series.time_s else 0.0) / 5.0))


def _x(series: TimeSeries, width: int) -> NDArray[np.float64]:
    return np.array(series.time_s) / _span_s(series) * (width - 1)


def _y(values: ArrayLike, limits: tuple[float, float], height: int) -> NDArray[np.float64]:
    low, high = limits
    return 3 + (high - np.asarray(values, dtype=float)) / (high - low) * (height - 7)


def _fixed(points: NDArray) -> NDArray[np.int32]:
    return np.rint(points * 2**_SHIFT).astype(np.int32)


def _value_at(time_s: list[float], values: list[float], now_s: float | None) -> float | None:
    """Return the value at a time, by default the last."""
    if not time_s:
        return None
    if now_s is None:
        return values[-1]
    return values[int(np.argmin(np.abs(np.array(time_s) - now_s)))]
