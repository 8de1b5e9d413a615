"""Look of the window: colors, fonts, text, cards and key hints."""

from __future__ import annotations

from functools import lru_cache
from typing import TypeAlias

import numpy as np
import pygame
import pygame_menu.font as fonts
from numpy.typing import NDArray

from layflat.data.names import storable

Color: TypeAlias = tuple[int, int, int]

BACKGROUND: Color = (17, 21, 28)
CARD: Color = (25, 31, 40)
RAISED: Color = (38, 46, 58)
LINE: Color = (52, 62, 77)
TEXT: Color = (231, 235, 241)
QUIET: Color = (150, 161, 177)
FAINT: Color = (98, 110, 127)
ACCENT: Color = (96, 156, 255)
CONTACT: Color = (70, 225, 150)
WORD: Color = (255, 196, 0)
"""CONTACT and WORD are the colors of layflat.perception.overlay, so that a curve and its image look alike."""
WARNING: Color = (255, 122, 96)
RECORDING: Color = (255, 84, 84)
HUMAN: Color = (198, 146, 255)
"""A person, not the policy, is in control."""

RADIUS = 8

REGULAR, BOLD, MONO = fonts.FONT_OPEN_SANS, fonts.FONT_OPEN_SANS_BOLD, fonts.FONT_FIRACODE
"""Fonts that pygame-menu ships: the system's fonts are never used."""


@lru_cache(maxsize=32)
def font(size: int, face: str = REGULAR) -> pygame.font.Font:
    """Return a font."""
    return pygame.font.Font(face, size)


@lru_cache(maxsize=600)
def render_text(text: str, size: int, color: Color, face: str = REGULAR) -> pygame.Surface:
    """Return a line of text as a picture; most of a frame's lines are those of the last."""
    return font(size, face).render(storable(text), True, color)


def clear_cache() -> None:
    """Forget pictures and fonts: they end with the display that they were made for."""
    font.cache_clear()
    render_text.cache_clear()


def draw_text(
    surface: pygame.Surface,
    text: str,
    place: tuple[int, int],
    size: int = 14,
    color: Color = TEXT,
    *,
    face: str = REGULAR,
    width: int | None = None,
    align: str = "left",
) -> pygame.Rect:
    """Draw one line at its top left (or top right) corner, truncated to ``width`` px; return what it covers."""
    if width is not None:
        text = truncate(text, size, width, face)
    picture = render_text(text, size, color, face)
    left = place[0] - (picture.get_width() if align == "right" else 0)
    return surface.blit(picture, (left, place[1]))


def make_picture(rgb: NDArray[np.uint8]) -> pygame.Surface:
    """Return an image (H, W, 3) as pygame draws it; do not change it as long as it is shown."""
    whole = np.ascontiguousarray(rgb)
    return pygame.image.frombuffer(whole.data, (whole.shape[1], whole.shape[0]), "RGB")


def text_width(text: str, size: int, face: str = REGULAR) -> int:
    """Return the width of a line, px."""
    return int(font(size, face).size(text)[0])


@lru_cache(maxsize=400)
def truncate(text: str, size: int, width: int, face: str = REGULAR) -> str:
    """Return the text, or as much of it as fits, with dots."""
    if text_width(text, size, face) <= width:
        return text
    while text and text_width(text + "…", size, face) > width:
        text = text[:-1]
    return text.rstrip() + "…"


@lru_cache(maxsize=200)
def wrap(text: str, size: int, width: int, face: str = REGULAR) -> tuple[str, ...]:
    """Return the text in lines that fit; a word that does not fit is truncated."""
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
            line = truncate(word, size, width, face)
        lines.append(line)
    return tuple(lines)


def draw_block(
    surface: pygame.Surface, text: str, area: pygame.Rect, size: int = 14, color: Color = QUIET, face: str = REGULAR
) -> int:
    """Draw wrapped text from the top of ``area``, as many lines as fit; return the y below it."""
    pitch = font(size, face).get_linesize()
    y = area.top
    for line in wrap(text, size, area.width, face):
        if y + pitch > area.bottom + 2:
            break
        draw_text(surface, line, (area.left, y), size, color, face=face)
        y += pitch
    return y


def draw_card(surface: pygame.Surface, area: pygame.Rect) -> None:
    """Draw a card with round corners."""
    pygame.draw.rect(surface, CARD, area, border_radius=RADIUS)


KEY_PX, KEY_PAD, KEY_HEIGHT, KEY_GAP = 13, 7, 24, 7


def key_hint_width(key: str, text: str) -> int:
    """Return the width of a key hint, px."""
    return max(text_width(key, KEY_PX, BOLD) + 2 * KEY_PAD, KEY_HEIGHT) + KEY_GAP + text_width(text, KEY_PX)


def draw_key_hint(surface: pygame.Surface, place: tuple[int, int], key: str, text: str, color: Color) -> pygame.Rect:
    """Draw a key in a box and its effect; return what they cover."""
    box = pygame.Rect(place, (max(text_width(key, KEY_PX, BOLD) + 2 * KEY_PAD, KEY_HEIGHT), KEY_HEIGHT))
    pygame.draw.rect(surface, RAISED, box, border_radius=6)
    picture, label = render_text(key, KEY_PX, color, BOLD), render_text(text, KEY_PX, QUIET)
    surface.blit(picture, picture.get_rect(center=box.center))
    surface.blit(label, label.get_rect(midleft=(box.right + KEY_GAP, box.centery)))
    return pygame.Rect(place, (key_hint_width(key, text), KEY_HEIGHT))
