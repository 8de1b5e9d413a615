"""Colours of the window, and Canvas: an area of it, with text and cards at the display's scale."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TypeAlias

import matplotlib
import numpy as np
import pygame
from numpy.typing import NDArray

from layflat.data.names import storable

Color: TypeAlias = tuple[int, int, int]

BACKGROUND: Color = (17, 21, 28)
CARD: Color = (25, 31, 40)
RAISED: Color = (38, 46, 58)
LINE: Color = (70, 82, 99)
TEXT: Color = (231, 235, 241)
QUIET: Color = (165, 175, 190)
"""At least 4.5:1 on a card."""
ACCENT: Color = (110, 168, 255)
CONTACT: Color = (70, 225, 150)
WORD: Color = (255, 196, 0)
"""CONTACT and WORD are the colours of layflat.perception.overlay, so that a curve and its image look alike."""
WARNING: Color = (255, 122, 96)
"""Something is wrong; never at rest."""
HUMAN: Color = (198, 146, 255)
"""A person, not the policy, is in control."""

RADIUS, KEY_TEXT, KEY_HEIGHT, KEY_PAD, KEY_GAP = 8, 13, 24, 7, 7


@lru_cache(maxsize=1)
def _font_files() -> tuple[Path, Path]:
    """Return DejaVu Sans and its bold face, which matplotlib ships: the system's fonts are never used."""
    folder = Path(matplotlib.get_data_path(), "fonts", "ttf")
    return folder / "DejaVuSans.ttf", folder / "DejaVuSans-Bold.ttf"


@lru_cache(maxsize=64)
def _font(size_px: int, bold: bool) -> pygame.font.Font:
    return pygame.font.Font(_font_files()[bold], size_px)


@lru_cache(maxsize=800)
def _render(text: str, size_px: int, color: Color, bold: bool) -> pygame.Surface:
    return _font(size_px, bold).render(text, True, color)


@lru_cache(maxsize=2000)
def _width(text: str, size_px: int, bold: bool) -> int:
    return int(_font(size_px, bold).size(text)[0])


def clear_cache() -> None:
    """Forget pictures and fonts: they end with the display that they were made for."""
    for cached in (_font, _render, _width):
        cached.cache_clear()


def make_picture(rgb: NDArray[np.uint8]) -> pygame.Surface:
    """Return an image (H, W, 3) as pygame draws it; do not change it as long as it is shown."""
    whole = np.ascontiguousarray(rgb)
    return pygame.image.frombuffer(whole.data, (whole.shape[1], whole.shape[0]), "RGB")


@dataclass(frozen=True)
class Canvas:
    """A surface and its scale; places are px of the surface, sizes of letters are px at scale 1."""

    surface: pygame.Surface
    scale: float = 1.0

    def px(self, length: float) -> int:
        """Return a length at scale 1 as px, at least one."""
        return max(round(length * self.scale), 1)

    @property
    def area(self) -> pygame.Rect:
        """Whole surface."""
        return self.surface.get_rect()

    def width(self, text: str, size: float = 14, *, bold: bool = False) -> int:
        """Return the width of a line, px."""
        return _width(storable(text), self.px(size), bold)

    def pitch(self, size: float = 14) -> int:
        """Return the height of a line, px."""
        return _font(self.px(size), False).get_linesize()

    def text(
        self,
        text: str,
        at: tuple[int, int],
        size: float = 14,
        color: Color = TEXT,
        *,
        bold: bool = False,
        align: str = "topleft",
    ) -> pygame.Rect:
        """Draw a line with its ``align`` (a name of pygame.Rect) at a place; return what it covers."""
        picture = _render(storable(text), self.px(size), color, bold)
        return self.surface.blit(picture, picture.get_rect(**{align: at}))

    def wrap(self, text: str, size: float, width: int, *, bold: bool = False) -> list[str]:
        """Return the text in lines that fit into ``width`` px; a word that is longer is divided."""
        lines, line = [], ""
        for word in text.split(" "):
            longer = f"{line} {word}" if line else word
            if self.width(longer, size, bold=bold) <= width:
                line = longer
                continue
            lines += [line] if line else []
            while self.width(word, size, bold=bold) > width and len(word) > 1:
                n = next(k for k in range(len(word) - 1, 0, -1) if k == 1 or self._fits(word[:k], size, width, bold))
                lines.append(word[:n])
                word = word[n:]
            line = word
        return [*lines, line] if line or not lines else lines

    def _fits(self, text: str, size: float, width: int, bold: bool) -> bool:
        return self.width(text, size, bold=bold) <= width

    def block(self, text: str, area: pygame.Rect, size: float = 14, color: Color = QUIET) -> int:
        """Draw wrapped text, smaller where it would not fit into ``area``; return the y below it."""
        while size > 6 and len(self.wrap(text, size, area.width)) * self.pitch(size) > area.height:
            size -= 0.5
        y = area.top
        for line in self.wrap(text, size, area.width):
            self.text(line, (area.left, y), size, color)
            y += self.pitch(size)
        return y

    def card(self, area: pygame.Rect | None = None) -> None:
        """Draw a card with round corners, by default over everything."""
        pygame.draw.rect(self.surface, CARD, area or self.area, border_radius=self.px(RADIUS))

    def key_width(self, key: str, text: str) -> int:
        """Return the width of a key chip, px."""
        return self._box_width(key) + self.px(KEY_GAP) + self.width(text, KEY_TEXT)

    def _box_width(self, key: str) -> int:
        return max(self.width(key, KEY_TEXT, bold=True) + 2 * self.px(KEY_PAD), self.px(KEY_HEIGHT))

    def key(self, at: tuple[int, int], key: str, text: str, color: Color) -> pygame.Rect:
        """Draw a key in a box and its effect; return what they cover."""
        box = pygame.Rect(at, (self._box_width(key), self.px(KEY_HEIGHT)))
        pygame.draw.rect(self.surface, RAISED, box, border_radius=self.px(6))
        self.text(key, box.center, KEY_TEXT, color, bold=True, align="center")
        label = self.text(text, (box.right + self.px(KEY_GAP), box.centery), KEY_TEXT, QUIET, align="midleft")
        return box.union(label)
