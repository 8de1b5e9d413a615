"""WindowLayout: the areas of a window of some size and scale."""

from __future__ import annotations

from dataclasses import dataclass

import pygame

SIZE = (1280, 760)
"""First size of the window at scale 1, px."""
FITS = (880, 640)
"""Size at scale 1 down to which everything has its place; in a smaller window everything is smaller."""
GAP, TOP = 8, 42


@dataclass(frozen=True, kw_only=True)
class WindowLayout:
    """Rectangles in px, which do not overlap."""

    window: pygame.Rect
    top: pygame.Rect
    """State, in one line."""
    facts: pygame.Rect
    """Numbers of the recording."""
    view: pygame.Rect
    """The simulation."""
    camera: pygame.Rect
    contact: pygame.Rect
    word: pygame.Rect
    message: pygame.Rect
    """Newest sentence."""
    hints: pygame.Rect
    """Effect of each button now."""


def fitting_scale(size: tuple[int, int], wanted: float) -> float:
    """Return the scale at which everything fits into a window of ``size`` px, at most the one that is wanted."""
    return min(wanted, size[0] / FITS[0], size[1] / FITS[1])


def layout(size: tuple[int, int], scale: float, *, facts: int, message: int, hints: int) -> WindowLayout:
    """Lay out a window of ``size`` px whose facts, message and hints are so many px high."""
    width, height = size
    gap = max(round(GAP * scale), 1)
    inner = width - 2 * gap
    top = pygame.Rect(gap, 0, inner, round(TOP * scale))
    facts_area = pygame.Rect(gap, top.bottom, inner, facts)
    hints_area = pygame.Rect(gap, height - hints - gap, inner, hints)
    message_area = pygame.Rect(gap, hints_area.top - message - gap, inner, message)
    y = facts_area.bottom + gap
    tall = max(message_area.top - gap - y, 4 * gap)
    right_width = round(min(max(inner * 0.30, 230 * scale), 0.42 * inner, 620 * scale))
    left = width - gap - right_width
    camera = pygame.Rect(left, y, right_width, min(right_width * 3 // 4, round(0.40 * tall)))
    rest = tall - camera.height - 2 * gap
    contact = pygame.Rect(left, camera.bottom + gap, right_width, rest // 2)
    word_top = contact.bottom + gap
    return WindowLayout(
        window=pygame.Rect((0, 0), size),
        top=top,
        facts=facts_area,
        view=pygame.Rect(gap, y, left - 2 * gap, tall),
        camera=camera,
        contact=contact,
        word=pygame.Rect(left, word_top, right_width, y + tall - word_top),
        message=message_area,
        hints=hints_area,
    )
