"""Where everything is in a window of some size."""

from __future__ import annotations

from dataclasses import dataclass

import pygame

SIZE = (1280, 720)
LEAST = (960, 600)
GAP = 8
TOP, STRIP, STATUS = 46, 74, 26


@dataclass(frozen=True, kw_only=True)
class WindowLayout:
    """Rectangles in px; nothing overlaps but what lies inside ``view``."""

    window: pygame.Rect
    top: pygame.Rect
    panel: pygame.Rect
    """At the left: the mode's menu, or how it goes."""
    view: pygame.Rect
    """The bench."""
    status: pygame.Rect
    """One line below the bench."""
    camera: pygame.Rect
    contact: pygame.Rect
    word: pygame.Rect
    text: pygame.Rect
    """Where modes without a bench write: view, status line and right column."""
    strip: pygame.Rect
    """What each button does now."""


def layout(size: tuple[int, int]) -> WindowLayout:
    """For a window of ``size`` px; a smaller one than LEAST is laid out as that and cut."""
    width, height = max(size[0], LEAST[0]), max(size[1], LEAST[1])
    top = pygame.Rect(0, 0, width, TOP)
    strip = pygame.Rect(GAP, height - STRIP - GAP, width - 2 * GAP, STRIP)
    y, tall = top.bottom + GAP, strip.top - GAP - (top.bottom + GAP)
    panel = pygame.Rect(GAP, y, 268 if width >= 1200 else 238, tall)
    right_width = min(max(int(width * 0.27), 272), 520)
    right = pygame.Rect(width - GAP - right_width, y, right_width, tall)
    middle = pygame.Rect(panel.right + GAP, y, right.left - panel.right - 2 * GAP, tall)
    camera = pygame.Rect(right.left, y, right_width, min(right_width * 3 // 4, tall // 2))
    left_over = tall - camera.height - 2 * GAP
    contact = pygame.Rect(right.left, camera.bottom + GAP, right_width, left_over * 11 // 20)
    word_top = contact.bottom + GAP
    return WindowLayout(
        window=pygame.Rect(0, 0, width, height),
        top=top,
        panel=panel,
        view=pygame.Rect(middle.left, y, middle.width, tall - STATUS),
        status=pygame.Rect(middle.left, y + tall - STATUS, middle.width, STATUS),
        camera=camera,
        contact=contact,
        word=pygame.Rect(right.left, word_top, right_width, y + tall - word_top),
        text=pygame.Rect(middle.left, y, right.right - middle.left, tall),
        strip=strip,
    )
