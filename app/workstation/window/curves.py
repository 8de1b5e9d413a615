"""Curves of contact portion and WORD over time."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pygame
from numpy.typing import ArrayLike, NDArray

from layflat.app.workstation.time_series import TimeSeries
from layflat.app.workstation.window import style
from layflat.app.workstation.window.style import Canvas

MIN_SPAN_S = 10.0
"""Shortest time axis."""
_PHASE_TINT = {"disturb": (92, 58, 24), "repair": (30, 60, 96)}
"""Background of a phase; placing has that of the card. They differ in luminance, and each bears its name."""
HUMAN_PX = 6
"""Height of the band below the curves where a person was in control."""
_SHIFT = 4
_SMALL = 11
_LEFT, _RIGHT, _TOP, _BOTTOM = 44, 14, 34, 24
"""Margins of the plot on its card."""


def draw_contact(canvas: Canvas, series: TimeSeries) -> None:
    """Draw the contact portion on a card."""
    text = f"{100 * series.contact[-1]:.0f} %" if series.contact else ""
    plot, picture = _start_plot(canvas, series, "Contact", text, style.CONTACT)
    _draw_grid(picture, (0.0, 0.5, 1.0))
    if series.time_s:
        height = plot.height
        line = np.stack([_x(series, plot.width), _y(np.clip(series.contact, 0, 1), (0.0, 1.0), height)], axis=1)
        shaded = np.vstack([line, [line[-1, 0], height], [line[0, 0], height]])
        tint = picture.copy()
        cv2.fillPoly(tint, [_fixed(shaded)], style.CONTACT, cv2.LINE_AA, _SHIFT)
        cv2.addWeighted(tint, 0.16, picture, 0.84, 0, picture)
        cv2.polylines(picture, [_fixed(line)], False, style.CONTACT, canvas.px(2), cv2.LINE_AA, _SHIFT)
    _finish_plot(canvas, picture, plot, series, ("0", "50", "100"))


def draw_word(canvas: Canvas, series: TimeSeries) -> None:
    """Draw WORD's angle to the robot's front on a card."""
    angle = series.angle_deg[-1] if series.angle_deg else None
    text = "" if angle is None else "none" if math.isnan(angle) else f"{round(angle) or 0:+d}°"
    plot, picture = _start_plot(canvas, series, "WORD", text, style.WORD)
    _draw_grid(picture, (-90.0, 0.0, 90.0))
    angles = np.array(series.angle_deg)
    known = np.isfinite(angles)
    if known.any():
        places = np.stack([_x(series, plot.width)[known], _y(angles[known], (-90.0, 90.0), plot.height)], axis=1)
        for x, y in _fixed(places).tolist():
            cv2.circle(picture, (x, y), int(2.2 * canvas.scale * 2**_SHIFT), style.WORD, -1, cv2.LINE_AA, _SHIFT)
    _finish_plot(canvas, picture, plot, series, ("-90°", "0°", "90°"))


def _start_plot(
    canvas: Canvas, series: TimeSeries, title: str, value: str, color: style.Color
) -> tuple[pygame.Rect, NDArray[np.uint8]]:
    """Draw the card and its heading; return the area of the curve, and its picture with tinted phases."""
    canvas.surface.fill(style.BACKGROUND)
    area, px = canvas.area, canvas.px
    canvas.card()
    canvas.text(title, (px(12), px(7)), 13, style.QUIET)
    canvas.text(value, (area.right - px(12), px(4)), 18, color, bold=True, align="topright")
    width, height = area.width - px(_LEFT) - px(_RIGHT), area.height - px(_TOP) - px(_BOTTOM)
    plot = pygame.Rect(px(_LEFT), px(_TOP), max(width, 10), max(height, 10))
    picture = np.full((plot.height, plot.width, 3), style.CARD, np.uint8)
    x = _x(series, plot.width)
    for k, phase in enumerate(series.phase):
        if phase in _PHASE_TINT:
            picture[:, int(x[k - 1]) if k else 0 : int(x[k]) + 1] = _PHASE_TINT[phase]
    return plot, picture


def _draw_grid(picture: NDArray[np.uint8], levels: tuple[float, ...]) -> None:
    height, width = picture.shape[:2]
    for y in np.rint(_y(levels, (levels[0], levels[-1]), height)).astype(int).tolist():
        cv2.line(picture, (0, y), (width, y), style.LINE, 1)


def _finish_plot(
    canvas: Canvas, picture: NDArray[np.uint8], plot: pygame.Rect, series: TimeSeries, labels: tuple[str, ...]
) -> None:
    """Draw the band of a person in control, names of phases, and the axes, whose ``labels`` go from low to high."""
    places, px = _x(series, plot.width), canvas.px
    for k, human in enumerate(series.human):
        if human and k:
            picture[-px(HUMAN_PX) :, int(places[k - 1]) : int(places[k]) + 1] = style.HUMAN
    canvas.surface.blit(style.make_picture(picture), plot)
    for k, phase in enumerate(series.phase):
        if phase in _PHASE_TINT and (k == 0 or series.phase[k - 1] != phase):
            at = (plot.left + int(places[max(k - 1, 0)]) + px(2), plot.top + px(1))
            canvas.text(phase, at, _SMALL, style.QUIET)
    heights = np.rint(_y(range(len(labels)), (0, len(labels) - 1), plot.height)).astype(int).tolist()
    for label, y in zip(labels, heights, strict=True):
        canvas.text(label, (plot.left - px(4), plot.top + y), _SMALL, style.QUIET, align="midright")
    bottom = canvas.area.bottom - px(4)
    canvas.text("0", (plot.left, bottom), _SMALL, style.QUIET, align="bottomleft")
    canvas.text(f"{_span_s(series):.0f} s", (plot.right, bottom), _SMALL, style.QUIET, align="bottomright")
    if any(series.human):
        canvas.text("you", (plot.centerx, bottom), _SMALL, style.HUMAN, align="midbottom")


def _span_s(series: TimeSeries) -> float:
    return max(MIN_SPAN_S, 5.0 * math.ceil((series.time_s[-1] if series.time_s else 0.0) / 5.0))


def _x(series: TimeSeries, width: int) -> NDArray[np.float64]:
    return np.array(series.time_s) / _span_s(series) * (width - 1)


def _y(values: ArrayLike, limits: tuple[float, float], height: int) -> NDArray[np.float64]:
    low, high = limits
    return 3 + (high - np.asarray(values, dtype=float)) / (high - low) * (height - 7)


def _fixed(points: NDArray) -> NDArray[np.int32]:
    return np.rint(points * 2**_SHIFT).astype(np.int32)
