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
    contact = np.clip(series.contact, 0, 1)
    text = f"{100 * series.contact[-1]:.0f} %" if series.contact else ""
    _draw(canvas, series, contact, (0.0, 1.0), ("Contact", text, style.CONTACT), ("0", "50", "100"), line=True)


def draw_word(canvas: Canvas, series: TimeSeries) -> None:
    """Draw WORD's angle to the robot's front on a card."""
    angle = series.angle_deg[-1] if series.angle_deg else None
    text = "" if angle is None else "none" if math.isnan(angle) else f"{round(angle) or 0:+d}°"
    angles = np.array(series.angle_deg)
    _draw(canvas, series, angles, (-90.0, 90.0), ("WORD", text, style.WORD), ("-90°", "0°", "90°"), line=False)


def _draw(
    canvas: Canvas, series: TimeSeries, values: NDArray, limits: tuple[float, float],
    heading: tuple[str, str, style.Color], labels: tuple[str, ...], *, line: bool,
) -> None:  # fmt: skip
    """Draw a card with title, newest value, phases and axes, whose ``labels`` go from low to high."""
    px, area, (title, text, color) = canvas.px, canvas.area, heading
    canvas.surface.fill(style.BACKGROUND)
    canvas.card()
    canvas.text(title, (px(12), px(7)), 13, style.QUIET)
    shown = style.QUIET if text == "none" else color
    canvas.text(text, (area.right - px(12), px(4)), 18, shown, bold=True, align="topright")
    width, height = area.width - px(_LEFT) - px(_RIGHT), area.height - px(_TOP) - px(_BOTTOM)
    plot = pygame.Rect(px(_LEFT), px(_TOP), max(width, 10), max(height, 10))
    picture = np.full((plot.height, plot.width, 3), style.CARD, np.uint8)
    span_s = max(MIN_SPAN_S, 5.0 * math.ceil((series.time_s[-1] if series.time_s else 0.0) / 5.0))
    x = np.array(series.time_s) / span_s * (plot.width - 1)
    steps = [slice(int(x[max(k - 1, 0)]), int(x[k]) + 1) for k in range(len(x))]
    for k, phase in enumerate(series.phase):
        if phase in _PHASE_TINT:
            picture[:, steps[k]] = _PHASE_TINT[phase]
    levels = np.rint(_y(range(len(labels)), (0, len(labels) - 1), plot.height)).astype(int).tolist()
    for y in levels:
        cv2.line(picture, (0, y), (plot.width, y), style.LINE, 1)
    known = np.isfinite(values)
    if known.any():
        points = np.stack([x, _y(values, limits, plot.height)], axis=1)[known]
        (_draw_line if line else _draw_dots)(picture, points, color, canvas)
    for k, human in enumerate(series.human):
        if human and k:
            picture[-px(HUMAN_PX) :, steps[k]] = style.HUMAN
    canvas.surface.blit(style.make_picture(picture), plot)
    for k, phase in enumerate(series.phase):
        if phase in _PHASE_TINT and (k == 0 or series.phase[k - 1] != phase):
            canvas.text(phase, (plot.left + steps[k].start + px(2), plot.top + px(1)), _SMALL, style.QUIET)
    for label, y in zip(labels, levels, strict=True):
        canvas.text(label, (plot.left - px(4), plot.top + y), _SMALL, style.QUIET, align="midright")
    bottom = area.bottom - px(4)
    canvas.text("0", (plot.left, bottom), _SMALL, style.QUIET, align="bottomleft")
    canvas.text(f"{span_s:.0f} s", (plot.right, bottom), _SMALL, style.QUIET, align="bottomright")
    if any(series.human):
        canvas.text("you", (plot.centerx, bottom), _SMALL, style.HUMAN, align="midbottom")


def _draw_line(picture: NDArray[np.uint8], points: NDArray, color: style.Color, canvas: Canvas) -> None:
    """Draw a line over a shaded area."""
    height, tint = picture.shape[0], picture.copy()
    shaded = np.vstack([points, [points[-1, 0], height], [points[0, 0], height]])
    cv2.fillPoly(tint, [_fixed(shaded)], color, cv2.LINE_AA, _SHIFT)
    cv2.addWeighted(tint, 0.16, picture, 0.84, 0, picture)
    cv2.polylines(picture, [_fixed(points)], False, color, canvas.px(2), cv2.LINE_AA, _SHIFT)


def _draw_dots(picture: NDArray[np.uint8], points: NDArray, color: style.Color, canvas: Canvas) -> None:
    for x, y in _fixed(points).tolist():
        cv2.circle(picture, (x, y), int(2.2 * canvas.scale * 2**_SHIFT), color, -1, cv2.LINE_AA, _SHIFT)


def _y(values: ArrayLike, limits: tuple[float, float], height: int) -> NDArray[np.float64]:
    low, high = limits
    return 3 + (high - np.asarray(values, dtype=float)) / (high - low) * (height - 7)


def _fixed(points: NDArray) -> NDArray[np.int32]:
    return np.rint(points * 2**_SHIFT).astype(np.int32)
