"""Painter: lays the contents out in a window of any size and scale; only what has changed is drawn again."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from functools import partial

import pygame

from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.window import panels, style
from layflat.app.workstation.window.contents import Contents
from layflat.app.workstation.window.curves import draw_contact, draw_word
from layflat.app.workstation.window.panels import KeyHint
from layflat.app.workstation.window.remote import RemoteUpdates, is_remote
from layflat.app.workstation.window.style import Canvas

FITS = (880, 640)
"""Size at scale 1 down to which everything has its place; in a smaller window everything is smaller."""
GAP, TOP = 8, 42
_Area = tuple[str, pygame.Rect, Hashable, Callable[[Canvas], None]]
"""Name, place, key of its content and function that draws it."""


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


class Painter:
    """Lays out and draws; ``wanted_scale`` is that of the display, times the person's zoom."""

    def __init__(self, surface: pygame.Surface, contents: Contents, wanted_scale: float) -> None:
        self.scale = 1.0
        """Px of the window for each px at scale 1."""
        self.layout: WindowLayout
        self._contents = contents
        self._drawn: dict[str, Hashable] = {}
        self._remote = RemoteUpdates() if is_remote() else None
        self._hints: dict[str, list[tuple[pygame.Rect, KeyHint]]] = {}
        self._heights: dict[str, int] = {}
        """Greatest heights that were needed at this size: words that come and go do not move the view each time."""
        self.resize(surface, wanted_scale)

    def resize(self, surface: pygame.Surface, wanted_scale: float) -> None:
        """Draw everything into another surface, or at another scale."""
        self.surface = surface
        self._wanted_scale = wanted_scale
        self._heights = {}
        self._hints = {}
        self.forget()
        self._measure()

    def forget(self) -> None:
        """Draw everything again in the next frame."""
        self._drawn.clear()
        if self._remote is not None:
            self._remote.forget()

    @property
    def hints(self) -> list[tuple[pygame.Rect, KeyHint]]:
        """Areas of the key chips that are drawn."""
        return [pair for pairs in self._hints.values() for pair in pairs]

    def draw(self) -> None:
        """Draw the areas whose key has changed since they were drawn; a remote display gets them when it has room."""
        if self._remote is not None and not self._remote.has_room():
            return
        self._measure()
        changed: list[pygame.Rect] = []
        for name, area, key, draw in self._areas():
            if self._drawn.get(name) != key:
                self._drawn[name] = key
                draw(self._canvas(area))
                changed.append(area)
        if self._remote is not None and changed:
            changed = self._remote.parts(self.surface, changed)
        if changed:
            pygame.display.update(changed)

    def _canvas(self, area: pygame.Rect) -> Canvas:
        return Canvas(self.surface.subsurface(area.clip(self.surface.get_rect())), self.scale)

    def _strip(self) -> list[KeyHint]:
        """Return the chips of the strip; those of the window are there, too, where the top has no room for them."""
        return [*self._contents.key_hints(), *([] if self._top() else self._contents.window_hints())]

    def _top(self) -> list[KeyHint]:
        """Return the chips beside the state."""
        hints, gap = self._contents.window_hints(), round(GAP * self.scale)
        whole = Canvas(self.surface.subsurface((0, 0, max(self.surface.get_width() - 2 * gap, 1), 1)), self.scale)
        return hints if panels.top_has_room(whole, hints) else []

    def _measure(self) -> None:
        """Lay out again, where something needs more room than it has."""
        size, contents = self.surface.get_size(), self._contents
        scale = fitting_scale(size, self._wanted_scale)
        if scale != self.scale:
            self.scale, self._heights = scale, {}
        wide = Canvas(self.surface.subsurface((0, 0, max(size[0] - 2 * round(GAP * scale), 1), size[1])), scale)
        self._hints_scale, hints_px = panels.hints_scale(wide, self._strip(), round(panels.STRIP_SHARE * size[1]))
        needed = {
            "facts": panels.facts_height(wide, contents.facts()),
            "message": max(panels.message_height(wide, contents.message()[0]), wide.pitch(panels.MESSAGE_TEXT)),
            "hints": hints_px,
        }
        if any(height > self._heights.get(name, 0) for name, height in needed.items()):
            self._heights = {name: max(height, self._heights.get(name, 0)) for name, height in needed.items()}
            self.layout = layout(size, scale, **self._heights)
            contents.inputs.view, contents.inputs.scale = self.layout.view, scale
            self._drawn.clear()

    def _areas(self) -> list[_Area]:
        place, contents, status = self.layout, self._contents, self._contents.status
        frame, seen, past = contents.frame(), contents.client.frame, contents.past
        window_hints, strip = self._top(), self._strip()
        facts, message = contents.facts(), contents.message()
        words, curve = panels.banner(status, contents.start_key(), contents.problem()), (past.episode, len(past.time_s))
        top = (panels.headline(status), tuple(hint[:2] for hint in window_hints))
        viewport, ghost, band = contents.inputs.viewport, contents.ghost.nodes, contents.inputs.device.band()
        hands = (viewport.hover, id(viewport.drag), id(viewport.hand), band)
        view = (id(frame), viewport.camera, hands, id(ghost), words)
        return [
            ("all", place.window, place.window.size, self._draw_background),
            ("top", place.top, top, partial(self._draw_top, window_hints)),
            ("facts", place.facts, tuple(facts), lambda c: panels.draw_facts(c, facts)),
            ("view", place.view, view, lambda c: self._draw_view(c, frame, words)),
            ("camera", place.camera, id(seen), lambda c: viewport.draw_camera(c, seen)),
            ("contact", place.contact, curve, lambda c: draw_contact(c, past)),
            ("word", place.word, curve, lambda c: draw_word(c, past)),
            ("message", place.message, message, lambda c: panels.draw_message(c, *message)),
            ("hints", place.hints, tuple(hint[:2] for hint in strip), partial(self._draw_strip, strip)),
        ]

    def _draw_background(self, canvas: Canvas) -> None:
        canvas.surface.fill(style.BACKGROUND)

    def _draw_top(self, hints: list[KeyHint], canvas: Canvas) -> None:
        self._place("top", panels.draw_top(canvas, self._contents.status, hints), hints, self.layout.top)

    def _draw_strip(self, hints: list[KeyHint], canvas: Canvas) -> None:
        self._place("strip", panels.draw_hints(canvas, hints, self._hints_scale), hints, self.layout.hints)

    def _draw_view(self, canvas: Canvas, frame: SimulationFrame, words: tuple[str, str]) -> None:
        contents, view = self._contents, self.layout.view
        contents.inputs.viewport.draw(canvas, frame, contents.ghost.nodes)
        hints = contents.view_hints()
        self._place("view", panels.draw_view_keys(canvas, hints), hints, view)
        band = contents.inputs.device.band()
        if band is not None:
            panels.draw_band(canvas, band, view.topleft)
        held = contents.inputs.viewport.pixel_of(frame.holder, view.size)[1]
        panels.draw_banner(canvas, *words, low=held < view.height // 2)

    def _place(self, name: str, areas: list[pygame.Rect], hints: list[KeyHint], where: pygame.Rect) -> None:
        pairs = zip(areas, hints, strict=False)
        self._hints[name] = [(area.move(where.topleft), hint) for area, hint in pairs]
