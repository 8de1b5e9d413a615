"""One look for the whole window: colours, fonts, text, chips and cards."""

from __future__ import annotations

from functools import lru_cache
from typing import TypeAlias

import numpy as np
import pygame
import pygame_menu.font as fonts
from numpy.typing import NDArray

Colour: TypeAlias = tuple[int, int, int]

GROUND: Colour = (17, 21, 28)
CARD: Colour = (25, 31, 40)
RAISED: Colour = (38, 46, 58)
LINE: Colour = (52, 62, 77)
TEXT: Colour = (231, 235, 241)
QUIET: Colour = (150, 161, 177)
FAINT: Colour = (98, 110, 127)
ACCENT: Colour = (96, 156, 255)
CONTACT: Colour = (70, 225, 150)
WORD: Colour = (255, 196, 0)
WARNING: Colour = (255, 122, 96)
RECORDING: Colour = (255, 84, 84)
LED: Colour = (198, 146, 255)
"""A person has the lead over a policy."""
"""CONTACT and WORD are the colours of layflat.perception.overlay, so that a curve and what it counts look alike."""

RADIUS = 8

REGULAR, BOLD, MONO = fonts.FONT_OPEN_SANS, fonts.FONT_OPEN_SANS_BOLD, fonts.FONT_FIRACODE
"""Fonts that pygame-menu ships: no font of the system is ever asked for."""


@lru_cache(maxsize=32)
def font(size: int, face: str = REGULAR) -> pygame.font.Font:
    return pygame.font.Font(face, size)


@lru_cache(maxsize=600)
def words(text: str, size: int, colour: Colour, face: str = REGULAR) -> pygame.Surface:
    """A line of text as a picture; most of a frame's lines are those of the last."""
    return font(size, face).render(text, True, colour)


def fresh() -> None:
    """Forget pictures and fonts: they end with the display that they were made for."""
    font.cache_clear()
    words.cache_clear()


def write(
    surface: pygame.Surface,
    text: str,
    place: tuple[int, int],
    size: int = 14,
    colour: Colour = TEXT,
    *,
    face: str = REGULAR,
    width: int | None = None,
    align: str = "left",
) -> pygame.Rect:
    """Draw one line at its top left (or top right) corner, cut to ``width`` px; returns where it went."""
    if width is not None:
        text = cut(text, size, width, face)
    picture = words(text, size, colour, face)
    left = place[0] - (picture.get_width() if align == "right" else 0)
    return surface.blit(picture, (left, place[1]))


def picture(rgb: NDArray[np.uint8]) -> pygame.Surface:
    """An image (H, W, 3) as pygame draws it; it must not be changed as long as it is shown."""
    whole = np.ascontiguousarray(rgb)
    return pygame.image.frombuffer(whole.data, (whole.shape[1], whole.shape[0]), "RGB")


def text_width(text: str, size: int, face: str = REGULAR) -> int:
    return int(font(size, face).size(text)[0])


@lru_cache(maxsize=400)
def cut(text: str, size: int, width: int, face: str = REGULAR) -> str:
    """The text, or as much of it as fits, with dots."""
    if text_width(text, size, face) <= width:
        return text
    while text and text_width(text + "…", size, face) > width:
        text = text[:-1]
    return text.rstrip() + "…"


@lru_cache(maxsize=200)
def wrapped(text: str, size: int, width: int, face: str = REGULAR) -> tuple[str, ...]:
    """The text in lines that fit; a word that does not fit is cut."""
    lines: list[str] = []
    for paragraph in text.split("\n"):
        line = ""
        for word in paragraph.split(" "):
            longer = f"{line} {word}" if line else word
            if text_width(longer, size, face) <= width:
                line = longer
                continue
            if line:
                lines.append(line)
            line = cut(word, size, width, face)
        lines.append(line)
    return tuple(lines)


def write_block(
    surface: pygame.Surface, text: str, area: pygame.Rect, size: int = 14, colour: Colour = QUIET, face: str = REGULAR
) -> int:
    """Draw wrapped text from the top of ``area``, as many lines as fit; returns the y below it."""
    pitch = font(size, face).get_linesize()
    y = area.top
    for line in wrapped(text, size, area.width, face):
        if y + pitch > area.bottom + 2:
            break
        write(surface, line, (area.left, y), size, colour, face=face)
        y += pitch
    return y


def card(surface: pygame.Surface, area: pygame.Rect, colour: Colour = CARD) -> None:
    pygame.draw.rect(surface, colour, area, border_radius=RADIUS)


def chip(
    surface: pygame.Surface,
    place: tuple[int, int],
    key: str,
    text: str,
    *,
    colour: Colour = TEXT,
    size: int = 13,
    width: int | None = None,
) -> pygame.Rect:
    """A key in a box and what it does now; returns what it covers."""
    pad, height = 7, size + 11
    box = pygame.Rect(place[0], place[1], max(text_width(key, size, BOLD) + 2 * pad, height), height)
    pygame.draw.rect(surface, RAISED, box, border_radius=6)
    picture = words(key, size, colour, BOLD)
    surface.blit(picture, picture.get_rect(center=box.center))
    left = box.right + 7
    if width is not None:
        text = cut(text, size, max(width - (left - place[0]), 10))
    label = words(text, size, QUIET)
    surface.blit(label, label.get_rect(midleft=(left, box.centery)))
    return pygame.Rect(place[0], place[1], left - place[0] + label.get_width(), height)
