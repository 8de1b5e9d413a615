"""The window's edges: tabs above, what is said below the bench, what each button does now, and a panel of rows."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import TYPE_CHECKING

import pygame

from layflat.app.workstation.session.intervention import YOU
from layflat.app.workstation.window import style
from layflat.app.workstation.window.pages.page import FormRow, KeyHint

if TYPE_CHECKING:
    from layflat.app.workstation.window.window import Window


def top_key(window: Window) -> Hashable:
    return (window.mode.name, _facts(window))


def _facts(window: Window) -> tuple[str, str]:
    """What stands at the right of the tabs: the device, and how fast time goes."""
    factor = float(window.shop.link.status.get("factor", 0.0) or 0.0)
    return window.hands.told(), f"{factor:.2f} × real time" if factor else ""


def paint_top(window: Window, surface: pygame.Surface) -> None:
    surface.fill(style.GROUND)
    x = style.write(surface, "Layflat", (16, 9), 20, style.TEXT, face=style.BOLD).right + 22
    window.tabs = []
    for mode in window.modes:
        chosen = mode is window.mode
        width = style.text_width(mode.name, 15, style.BOLD if chosen else style.REGULAR) + 22
        area = pygame.Rect(x, 8, width, 32)
        if chosen:
            pygame.draw.rect(surface, style.RAISED, area, border_radius=style.RADIUS)
        picture = style.words(
            mode.name, 15, style.TEXT if chosen else style.QUIET, style.BOLD if chosen else style.REGULAR
        )
        surface.blit(picture, picture.get_rect(center=area.center))
        window.tabs.append((area, mode))
        x = area.right + 2
    device, factor = _facts(window)
    right = surface.get_width() - 16
    if factor:
        right = style.write(surface, factor, (right, 14), 13, style.QUIET, align="right").left - 18
    room = right - x - 10
    if device and room > 60:
        style.write(surface, style.cut(device, 13, room), (right, 14), 13, style.QUIET, align="right")


def status_key(window: Window) -> Hashable:
    status = window.shop.link.status
    return (window.shop.message, window.shop.message_colour, status.get("rhythm"), status.get("leads"))


def paint_status(window: Window, surface: pygame.Surface) -> None:
    """Who leads, where two may, and the newest sentence at the left; the cadence at the right."""
    surface.fill(style.GROUND)
    status = window.shop.link.status
    rhythm, leads = str(status.get("rhythm", "")), str(status.get("leads", ""))
    x, room = 4, surface.get_width()
    if leads:
        told, colour = ("you lead", style.LED) if leads == YOU else (f"{leads} leads", style.TEXT)
        x = style.write(surface, told, (x, 4), 13, colour, face=style.BOLD).right + 14
    if rhythm and not window.shop.message:
        style.write(surface, rhythm, (x, 5), 12, style.FAINT, width=room - x - 4)
        return
    width = style.text_width(window.shop.message, 13)
    style.write(surface, window.shop.message, (x, 4), 13, window.shop.message_colour, width=room - x - 4)
    left = room - x - width - 24
    if rhythm and style.text_width(rhythm, 12) < left:
        style.write(surface, rhythm, (room - 4, 5), 12, style.FAINT, align="right")


def paint_strip(window: Window, surface: pygame.Surface) -> None:
    """All buttons in as many lines as there is room for."""
    surface.fill(style.GROUND)
    style.card(surface, surface.get_rect())
    corner = window.shop.place.strip.topleft
    window.chips = []
    x, y, pitch = 14, 9, 30
    for chip in window.mode.chips():
        width = _chip_width(chip)
        if x + width > surface.get_width() - 10 and x > 14:
            x, y = 14, y + pitch
        if y + pitch > surface.get_height():
            break
        area = style.chip(surface, (x, y), chip.key, chip.does, colour=chip.colour)
        window.chips.append((area.move(corner), chip.act))
        x = area.right + 20


def _chip_width(chip: KeyHint) -> int:
    return max(style.text_width(chip.key, 13, style.BOLD) + 14, 24) + 7 + style.text_width(chip.does, 13)


def paint_rows(surface: pygame.Surface, headline: tuple[str, style.Colour], rows: Sequence[FormRow]) -> None:
    """A panel that says how it goes."""
    width = surface.get_width()
    title, colour = headline
    pygame.draw.circle(surface, colour, (22, 30), 6)
    style.write(surface, title, (38, 15), 20, style.TEXT, face=style.BOLD, width=width - 50)
    y = 58
    for row in rows:
        area = pygame.Rect(16, y + 17, width - 32, surface.get_height() - y - 20)
        if area.height < 20:
            break
        style.write(surface, row.name, (16, y), 12, style.QUIET)
        y = style.write_block(surface, row.value, area, 15, row.colour) + 5


def paint_banner(surface: pygame.Surface, large: str, small: str) -> None:
    """Words over the bench."""
    if not large:
        return
    size = 64 if len(large) <= 3 else 26
    title, under = style.words(large, size, style.TEXT, style.BOLD), style.words(small, 15, style.QUIET)
    width = max(title.get_width(), under.get_width()) + 60
    height = title.get_height() + (under.get_height() + 4 if small else 0) + 28
    area = pygame.Rect(0, 0, min(width, surface.get_width() - 20), height)
    area.midtop = (surface.get_width() // 2, 24)
    veil = pygame.Surface(area.size, pygame.SRCALPHA)
    pygame.draw.rect(veil, (*style.GROUND, 205), veil.get_rect(), border_radius=12)
    surface.blit(veil, area)
    surface.blit(title, title.get_rect(midtop=(area.centerx, area.top + 12)))
    if small:
        surface.blit(under, under.get_rect(midbottom=(area.centerx, area.bottom - 14)))
