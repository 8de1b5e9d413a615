"""WindowLayout: the areas of a window of some size."""

from __future__ import annotations

from dataclasses import dataclass

import pygame

SIZE = (1280, 720)
MIN_SIZE = (960, 600)
GAP = 8
TOP, HINTS, STATUS = 46, 74, 26


@dataclass(frozen=True, kw_only=True)
class WindowLayout:
    """Rectangles in px, which do not overlap; ``text`` takes the place of the view and what is right of it."""

    window: pygame.Rect
    top: pygame.Rect
    panel: pygame.Rect
    """Left column: the page's menu, or its state."""
    view: pygame.Rect
    """The simulation."""
    status: pygame.Rect
    """One line below the view."""
    camera: pygame.Rect
    contact: pygame.Rect
    word: pygame.Rect
    text: pygame.Rect
    """Area of pages without a simulation: view, status line and right column."""
    hints: pygame.Rect
    """Effect of each button now."""


def layout(size: tuple[int, int]) -> WindowLayout:
    """Lay out a window of ``size`` px; a smaller one than MIN_SIZE is laid out as that and cut."""
    width, height = max(size[0], MIN_SIZE[0]), max(size[1], MIN_SIZE[1])
    top = pygame.Rect(0, 0, width, TOP)
    hints = pygame.Rect(GAP, height - HINTS - GAP, width - 2 * GAP, HINTS)
    y, tall = top.bottom + GAP, hints.top - GAP - (top.bottom + GAP)
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
        hints=hints,
    )
