"""Edges of the window: tabs above, the status line below the view, key hints, and a panel of rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pygame

from layflat.app.workstation.session.intervention import YOU
from layflat.app.workstation.window import style
from layflat.app.workstation.window.context import FormRow, KeyHint


def real_time_factor(status: Mapping[str, Any]) -> str:
    """Return how fast simulated time runs, for a person."""
    factor = float(status.get("real_time_factor", 0.0) or 0.0)
    return f"{factor:.2f} × real time" if factor else ""


def draw_top(surface: pygame.Surface, names: Sequence[str], chosen: str, device: str, factor: str) -> list[pygame.Rect]:
    """Draw the tabs, the device and how fast time runs; return the tabs' areas."""
    surface.fill(style.BACKGROUND)
    x = style.draw_text(surface, "Layflat", (16, 9), 20, style.TEXT, face=style.BOLD).right + 22
    tabs = []
    for name in names:
        face, color = (style.BOLD, style.TEXT) if name == chosen else (style.REGULAR, style.QUIET)
        area = pygame.Rect(x, 8, style.text_width(name, 15, face) + 22, 32)
        if name == chosen:
            pygame.draw.rect(surface, style.RAISED, area, border_radius=style.RADIUS)
        picture = style.render_text(name, 15, color, face)
        surface.blit(picture, picture.get_rect(center=area.center))
        tabs.append(area)
        x = area.right + 2
    right = surface.get_width() - 16
    if factor:
        right = style.draw_text(surface, factor, (right, 14), 13, style.QUIET, align="right").left - 18
    room = right - x - 10
    if device and room > 60:
        style.draw_text(surface, style.truncate(device, 13, room), (right, 14), 13, style.QUIET, align="right")
    return tabs


def draw_status(surface: pygame.Surface, message: str, color: style.Color, status: Mapping[str, Any]) -> None:
    """Draw who is in control and the newest message at the left, and the timing at the right."""
    surface.fill(style.BACKGROUND)
    timing, controller = str(status.get("timing", "")), str(status.get("controller", ""))
    x, room = 4, surface.get_width()
    if controller:
        human = controller == YOU
        text = "you are in control" if human else f"{controller} is in control"
        text_color = style.HUMAN if human else style.TEXT
        x = style.draw_text(surface, text, (x, 4), 13, text_color, face=style.BOLD).right + 14
    if timing and not message:
        style.draw_text(surface, timing, (x, 5), 12, style.FAINT, width=room - x - 4)
        return
    width = style.text_width(message, 13)
    style.draw_text(surface, message, (x, 4), 13, color, width=room - x - 4)
    left = room - x - width - 24
    if timing and style.text_width(timing, 12) < left:
        style.draw_text(surface, timing, (room - 4, 5), 12, style.FAINT, align="right")


def draw_key_hints(surface: pygame.Surface, hints: Sequence[KeyHint]) -> list[pygame.Rect]:
    """Draw key hints in as many lines as there is room for; return the areas of those drawn."""
    surface.fill(style.BACKGROUND)
    style.draw_card(surface, surface.get_rect())
    areas = []
    x, y, pitch = 14, 9, 30
    for hint in hints:
        if x + style.key_hint_width(hint.key, hint.text) > surface.get_width() - 10 and x > 14:
            x, y = 14, y + pitch
        if y + pitch > surface.get_height():
            break
        areas.append(style.draw_key_hint(surface, (x, y), hint.key, hint.text, hint.color))
        x = areas[-1].right + 20
    return areas


def draw_rows(surface: pygame.Surface, headline: tuple[str, style.Color], rows: Sequence[FormRow]) -> None:
    """Draw a panel that shows a page's state."""
    width = surface.get_width()
    title, color = headline
    pygame.draw.circle(surface, color, (22, 30), 6)
    style.draw_text(surface, title, (38, 15), 20, style.TEXT, face=style.BOLD, width=width - 50)
    y = 58
    for row in rows:
        area = pygame.Rect(16, y + 17, width - 32, surface.get_height() - y - 20)
        if area.height < 20:
            break
        style.draw_text(surface, row.name, (16, y), 12, style.QUIET)
        y = style.draw_block(surface, row.value, area, 15, row.color) + 5


def draw_banner(surface: pygame.Surface, large: str, small: str) -> None:
    """Draw words over the view."""
    if not large:
        return
    size = 64 if len(large) <= 3 else 26
    title, under = style.render_text(large, size, style.TEXT, style.BOLD), style.render_text(small, 15, style.QUIET)
    width = max(title.get_width(), under.get_width()) + 60
    height = title.get_height() + (under.get_height() + 4 if small else 0) + 28
    area = pygame.Rect(0, 0, min(width, surface.get_width() - 20), height)
    area.midtop = (surface.get_width() // 2, 24)
    veil = pygame.Surface(area.size, pygame.SRCALPHA)
    pygame.draw.rect(veil, (*style.BACKGROUND, 205), veil.get_rect(), border_radius=12)
    surface.blit(veil, area)
    surface.blit(title, title.get_rect(midtop=(area.centerx, area.top + 12)))
    if small:
        surface.blit(under, under.get_rect(midbottom=(area.centerx, area.bottom - 14)))
