"""Contact portion and WORD over time, drawn as they grow."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import cv2
import numpy as np
import pygame
from numpy.typing import NDArray

from layflat.app.workstation.session.frame_channel import BenchFrame
from layflat.app.workstation.window import style
from layflat.data.types import Episode

LEAST_S = 10.0
"""The time axis is never shorter."""
_PHASE_TINT = {"disturb": (74, 40, 44), "repair": (34, 50, 66)}
"""Ground of a phase; placing has that of the card."""
LED_PX = 6
"""Height of the band below the curves where a person had the lead."""
_SHIFT = 4


@dataclass
class TimeSeries:
    """What was, step by step, of one episode."""

    episode: int = -1
    time_s: list[float] = field(default_factory=list)
    contact: list[float] = field(default_factory=list)
    angle_deg: list[float] = field(default_factory=list)
    """Of WORD, -90..90; NaN where there is no direction."""
    phase: list[str] = field(default_factory=list)
    led: list[bool] = field(default_factory=list)
    """Whether a person had the lead over a policy in the step before."""

    def add(self, moment: BenchFrame) -> None:
        """Take note of a moment; another episode, or going back in time, begins anew."""
        if moment.episode != self.episode or (self.time_s and moment.sim_s < self.time_s[-1] - 1e-9):
            self.__init__(moment.episode)  # type: ignore[misc]
        if self.time_s and moment.sim_s <= self.time_s[-1] + 1e-9:
            return
        self.time_s.append(moment.sim_s)
        self.contact.append(moment.contact)
        self.angle_deg.append(_angle(moment.word))
        self.phase.append(moment.phase)
        self.led.append(moment.led)

    @staticmethod
    def of(episode: Episode, number: int) -> TimeSeries:
        """All of a recorded episode."""
        seen = episode.observations()
        phases = [step.phase for step in episode.steps]
        return TimeSeries(
            episode=number,
            time_s=[one.time_s for one in seen],
            contact=[one.contact_portion for one in seen],
            angle_deg=[_angle(one.word) for one in seen],
            phase=[*phases, phases[-1] if phases else "place"],
            led=[False, *(step.intervention for step in episode.steps)],
        )


def _angle(word: NDArray[np.float64]) -> float:
    return math.degrees(math.atan2(word[1], word[0])) if np.any(word) else math.nan


def draw_contact(surface: pygame.Surface, history: TimeSeries, now_s: float | None = None) -> None:
    """The contact portion on a card of its own; ``now_s`` marks a moment (replay)."""
    area = surface.get_rect()
    value = _value_at(history.time_s, history.contact, now_s)
    plot = _frame(surface, "Contact", "" if value is None else f"{100 * value:.0f} %", style.CONTACT)
    canvas = _canvas(plot, history)
    for share in (0.0, 0.5, 1.0):
        y = _y(share, 0.0, 1.0, plot.height)
        cv2.line(canvas, (0, y), (plot.width, y), style.LINE, 1)
    if history.time_s:
        line = np.stack([_x(history, plot.width), _y_all(np.clip(history.contact, 0, 1), 0.0, 1.0, plot.height)], 1)
        shaded = np.vstack([line, [line[-1, 0], plot.height], [line[0, 0], plot.height]])
        tint = canvas.copy()
        cv2.fillPoly(tint, [_fixed(shaded)], style.CONTACT, cv2.LINE_AA, _SHIFT)
        cv2.addWeighted(tint, 0.16, canvas, 0.84, 0, canvas)
        cv2.polylines(canvas, [_fixed(line)], False, style.CONTACT, 2, cv2.LINE_AA, _SHIFT)
    _finish(surface, canvas, plot, history, now_s)
    for share, text in ((1.0, "100"), (0.5, "50"), (0.0, "0")):
        y = plot.top + _y(share, 0.0, 1.0, plot.height)
        style.write(surface, text, (plot.left - 5, y - 8), 11, style.FAINT, align="right")
    _time_axis(surface, area, plot, history)


def draw_word(surface: pygame.Surface, history: TimeSeries, now_s: float | None = None, label: str = "WORD") -> None:
    """WORD's angle to the robot's front."""
    area = surface.get_rect()
    angle = _value_at(history.time_s, history.angle_deg, now_s)
    told = "" if angle is None else "none" if math.isnan(angle) else f"{round(angle) or 0:+d}°"
    plot = _frame(surface, label, told, style.WORD)
    canvas = _canvas(plot, history)
    for degrees in (-90, 0, 90):
        y = _y(degrees, -90, 90, plot.height)
        cv2.line(canvas, (0, y), (plot.width, y), style.LINE, 1)
    if history.time_s:
        angles = np.array(history.angle_deg)
        known = np.isfinite(angles)
        places = np.stack([_x(history, plot.width)[known], _y_all(angles[known], -90, 90, plot.height)], axis=1)
        for x, y in _fixed(places).tolist():
            cv2.circle(canvas, (x, y), int(2.2 * 2**_SHIFT), style.WORD, -1, cv2.LINE_AA, _SHIFT)
    _finish(surface, canvas, plot, history, now_s)
    for degrees in (90, 0, -90):
        y = plot.top + _y(degrees, -90, 90, plot.height)
        style.write(surface, f"{degrees}°", (plot.left - 4, y - 8), 11, style.FAINT, align="right")
    _time_axis(surface, area, plot, history)


def _frame(surface: pygame.Surface, title: str, value: str, colour: style.Colour) -> pygame.Rect:
    """The card with its heading; returns where the curve goes."""
    surface.fill(style.GROUND)
    area = surface.get_rect()
    style.card(surface, area)
    style.write(surface, title, (12, 7), 13, style.QUIET)
    style.write(surface, value, (area.width - 12, 3), 18, colour, face=style.BOLD, align="right")
    return pygame.Rect(42, 34, area.width - 42 - 14, max(area.height - 34 - 24, 10))


def _canvas(plot: pygame.Rect, history: TimeSeries) -> NDArray[np.uint8]:
    canvas = np.full((plot.height, plot.width, 3), style.CARD, np.uint8)
    x = _x(history, plot.width)
    for k, phase in enumerate(history.phase):
        if phase in _PHASE_TINT:
            left = int(x[k - 1]) if k else 0
            canvas[:, left : int(x[k]) + 1] = _PHASE_TINT[phase]
    return canvas


def _finish(
    surface: pygame.Surface, canvas: NDArray[np.uint8], plot: pygame.Rect, history: TimeSeries, now_s: float | None
) -> None:
    places = _x(history, plot.width)
    for k, led in enumerate(history.led):
        if led and k:
            canvas[-LED_PX:, int(places[k - 1]) : int(places[k]) + 1] = style.LED
    if now_s is not None:
        x = int(now_s / _span_s(history) * (plot.width - 1))
        cv2.line(canvas, (x, 0), (x, plot.height), style.TEXT, 1)
    surface.blit(style.picture(canvas), plot)


def _time_axis(surface: pygame.Surface, area: pygame.Rect, plot: pygame.Rect, history: TimeSeries) -> None:
    span = _span_s(history)
    style.write(surface, "0", (plot.left - 3, area.bottom - 21), 11, style.FAINT)
    style.write(surface, f"{span:.0f} s", (plot.right, area.bottom - 21), 11, style.FAINT, align="right")


def _span_s(history: TimeSeries) -> float:
    return max(LEAST_S, 5.0 * math.ceil((history.time_s[-1] if history.time_s else 0.0) / 5.0))


def _x(history: TimeSeries, width: int) -> NDArray[np.float64]:
    return np.array(history.time_s) / _span_s(history) * (width - 1)


def _y_all(values: NDArray, low: float, high: float, height: int) -> NDArray[np.float64]:
    return 3 + (high - np.asarray(values, dtype=float)) / (high - low) * (height - 7)


def _y(value: float, low: float, high: float, height: int) -> int:
    return round(float(_y_all(np.array([value]), low, high, height)[0]))


def _fixed(points: NDArray) -> NDArray[np.int32]:
    return np.rint(points * 2**_SHIFT).astype(np.int32)


def _value_at(time_s: list[float], values: list[float], now_s: float | None) -> float | None:
    """The value at a moment, by default the last."""
    if not time_s:
        return None
    if now_s is None:
        return values[-1]
    return values[int(np.argmin(np.abs(np.array(time_s) - now_s)))]
