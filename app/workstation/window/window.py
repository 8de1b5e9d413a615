"""Window: events in, pages, and everything drawn; only what has changed is drawn again."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Hashable
from functools import partial
from pathlib import Path

import pygame

from layflat.app.support.errors import INTERRUPTED
from layflat.app.workstation import settings
from layflat.app.workstation.preview import initial_frame
from layflat.app.workstation.session.activity_client import ActivityClient, start_fork_server
from layflat.app.workstation.session.activity_process import ActivityFactory
from layflat.app.workstation.session.frame_channel import SimulationFrame
from layflat.app.workstation.teleop import sdl
from layflat.app.workstation.window import panels, style
from layflat.app.workstation.window.context import WindowContext
from layflat.app.workstation.window.input_manager import InputManager
from layflat.app.workstation.window.layout import MIN_SIZE, SIZE, layout
from layflat.app.workstation.window.pages.data import DataPage
from layflat.app.workstation.window.pages.page import ASK_AGAIN_S, Page
from layflat.app.workstation.window.pages.place import PlacePage
from layflat.app.workstation.window.pages.record import RecordPage
from layflat.app.workstation.window.pages.replay import ReplayPage
from layflat.app.workstation.window.pages.settings import SettingsPage
from layflat.app.workstation.window.pages.train import TrainPage
from layflat.app.workstation.window.time_series import draw_contact, draw_word
from layflat.app.workstation.window.viewport import Viewport

FRAMES_HZ = 30
REPEAT_MS = (350, 40)
"""Time until a held key repeats, and between two repetitions."""
TITLE = "Layflat"
_Area = tuple[str, pygame.Rect, Hashable, Callable[[pygame.Surface], None]]
"""Name, place, key of its content and function that draws it."""


class Window:
    """The whole program while it is open: ``frame`` runs one round, ``run`` all of them."""

    def __init__(
        self,
        folder: Path,
        make: ActivityFactory,
        *,
        size: tuple[int, int] = SIZE,
        start: str = "Record",
        remember: bool = True,
    ) -> None:
        """Open on the page ``start``; ``remember``: read and write the settings of ``folder``."""
        # There is no sound, so do not open a sound card.
        os.environ.setdefault("SDL_AUDIODRIVER", "dummy")
        sdl.prepare()
        pygame.init()
        style.clear_cache()
        pygame.display.set_caption(TITLE)
        self.surface = pygame.display.set_mode(size, pygame.RESIZABLE)
        start_fork_server()
        self.context = WindowContext(
            folder=folder,
            settings=settings.load(folder) if remember else settings.Settings(),
            remember=remember,
            client=ActivityClient(make),
            layout=layout(self.surface.get_size()),
        )
        self.viewport = Viewport()
        self.input_manager = InputManager(self.context, self.viewport)
        self.record_page = RecordPage(self.context, input_manager=self.input_manager)
        self.pages: list[Page] = [
            self.record_page,
            TrainPage(self.context),
            PlacePage(self.context, input_manager=self.input_manager),
            PlacePage(self.context, name="Disturb", fast_forward=True, input_manager=self.input_manager),
            ReplayPage(self.context),
            DataPage(self.context),
            SettingsPage(self.context),
        ]
        self.page = next(page for page in self.pages if page.name == start)
        self.open = True
        self.interrupted = False
        self.frames_s: list[float] = []
        """Wall time of the work of each of the last frames."""
        self.tabs: list[tuple[pygame.Rect, Page]] = []
        self.hints: list[tuple[pygame.Rect, Callable[[], None] | None]] = []
        """Areas of the key hints that are drawn, and what a click on them does."""
        self._closed = False
        self._keys_repeat = False
        self._drawn: dict[str, Hashable] = {}
        self._asked: tuple[str, float] = ("", 0.0)
        self._menu_touched = 0
        self.page.enter()

    # Rounds

    def run(self, until: Callable[[], bool] = lambda: False) -> int:
        """Run until the window is closed, the program interrupted, or ``until`` is True; return the exit status."""
        clock = pygame.time.Clock()
        before = {number: signal.signal(number, self._interrupt) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            while self.open and not until():
                self.frame()
                clock.tick(FRAMES_HZ)
        finally:
            self.close()
            for number, handler in before.items():
                signal.signal(number, handler)
        return INTERRUPTED if self.interrupted else 0

    def _interrupt(self, number: int, frame: object) -> None:
        self.open, self.interrupted = False, True

    def frame(self) -> None:
        """Handle events of the window and the activity, send the input, and draw what has changed."""
        began = time.perf_counter()
        self._repeat_keys()
        self._handle_events(pygame.event.get())
        self.page.on_event(self.context.client.poll_events())
        self.input_manager.send(accepts_drag=self.page.accepts_drag())
        self.page.update()
        self.draw()
        self.frames_s.append(time.perf_counter() - began)
        del self.frames_s[:-200]

    def _repeat_keys(self) -> None:
        """Let held keys repeat in menus and in a replay, but not where each press is a command of a recording."""
        wanted = not self.context.client.alive
        if wanted != self._keys_repeat:
            self._keys_repeat = wanted
            pygame.key.set_repeat(*(REPEAT_MS if wanted else ()))

    def close(self) -> None:
        """End everything that was started and save its results durably; may be called twice."""
        self.open = False
        if self._closed:
            return
        self._closed = True
        self.page.leave()
        for page in self.pages:
            page.close()
        self.context.client.end()
        self.input_manager.release()
        # Not pygame.quit(): pygame-menu keeps its fonts for a next window, and a font without its library crashes.
        pygame.display.quit()

    # Events

    def _handle_events(self, events: list[pygame.event.Event]) -> None:
        rest: list[pygame.event.Event] = []
        for event in events:
            if event.type == pygame.QUIT:
                self.open = False
            elif event.type in (pygame.VIDEORESIZE, pygame.WINDOWSIZECHANGED):
                self._resize()
            elif not (self._click(event) or self.input_manager.handle_event(event) or self._handle_mouse(event)):
                rest.append(event)
        for event in rest:
            menu = self.page.menu
            if menu is not None:
                # One by one: of a press and its release in one frame a menu would only see the first.
                menu.update([event])
                self._menu_touched += 1
            if menu is None or event.type != pygame.KEYDOWN:
                self.page.handle_event(event)

    def _resize(self) -> None:
        width, height = pygame.display.get_surface().get_size()
        size = (max(width, MIN_SIZE[0]), max(height, MIN_SIZE[1]))
        if size != (width, height):
            pygame.display.set_mode(size, pygame.RESIZABLE)
        self.surface = pygame.display.get_surface()
        self.context.layout = layout(self.surface.get_size())
        self._drawn.clear()
        self.page.on_resize()

    def _click(self, event: pygame.event.Event) -> bool:
        """Handle a click on a tab or a key hint."""
        if event.type != pygame.MOUSEBUTTONDOWN or event.button != 1:
            return False
        targets = [(area, partial(self.choose, page)) for area, page in self.tabs]
        for area, press in [*targets, *self.hints]:
            if area.collidepoint(event.pos) and press is not None:
                press()
                return True
        return False

    def choose(self, page: Page) -> None:
        """Go to another page; something that runs here is only ended on a second request."""
        if page is self.page:
            return
        busy = self.page.busy()
        now = time.monotonic()
        if busy and (self._asked[0] != page.name or now - self._asked[1] > ASK_AGAIN_S):
            self._asked = (page.name, now)
            self.context.show_message(f"{page.name} would end {busy}; click again to go there", style.WARNING)
            return
        self.page.leave()
        self.viewport.release()
        self.viewport.hover = None
        self.context.show_message("")
        self.page = page
        self._drawn.clear()
        self.page.enter()

    def _handle_mouse(self, event: pygame.event.Event) -> bool:
        """Handle the mouse over the view; return whether the event is done with."""
        view, viewport, page = self.context.layout.view, self.viewport, self.page
        if event.type == pygame.MOUSEBUTTONUP and viewport.dragging:
            viewport.release()
            return True
        mouse = (pygame.MOUSEBUTTONDOWN, pygame.MOUSEMOTION, pygame.MOUSEWHEEL)
        if page.shows != "simulation" or event.type not in mouse:
            return False
        if event.type == pygame.MOUSEMOTION and viewport.dragging:
            viewport.move(event.rel, view.size)
            return True
        pos = pygame.mouse.get_pos() if event.type == pygame.MOUSEWHEEL else event.pos
        if not view.collidepoint(pos) or page.handle_event(event):
            return view.collidepoint(pos)
        at = (pos[0] - view.left, pos[1] - view.top)
        if event.type == pygame.MOUSEWHEEL:
            viewport.zoom(event.precise_y if hasattr(event, "precise_y") else event.y)
        elif event.type == pygame.MOUSEBUTTONDOWN and event.button in (1, 2, 3):
            viewport.press(at, event.button, view.size, page.frame(), page.accepts_drag())
        elif event.type == pygame.MOUSEMOTION:
            viewport.point(at, view.size, page.frame(), page.accepts_drag())
        return True

    # Drawing

    def draw(self) -> None:
        """Draw the areas whose key has changed since they were drawn."""
        changed: list[pygame.Rect] = []
        for name, area, key, draw in self._areas():
            if self._drawn.get(name) != key:
                self._drawn[name] = key
                draw(self.surface.subsurface(area.clip(self.surface.get_rect())))
                changed.append(area)
        if changed:
            pygame.display.update(changed)

    def redraw(self) -> None:
        """Draw everything."""
        self._drawn.clear()
        self.draw()

    def _areas(self) -> list[_Area]:
        place, page, status = self.context.layout, self.page, self.context.client.status
        everything_new = "all" not in self._drawn
        top = (page.name, self.input_manager.describe(), panels.real_time_factor(status))
        areas: list[_Area] = [
            ("all", place.window, place.window.size, self._draw_background),
            ("top", place.top, top, partial(self._draw_top, top)),
            ("panel", place.panel, self._panel_key(), self._draw_panel),
            ("hints", place.hints, tuple(hint[:2] for hint in page.key_hints()), self._draw_key_hints),
        ]
        if page.shows == "text":
            now = time.monotonic()
            return [*areas, ("text", place.text, now if everything_new else int(10 * now), page.draw_text)]
        frame, (series, now_s) = page.frame(), page.series()
        curve = (series.episode, len(series.time_s), now_s)
        shown = frame or initial_frame(self.context.settings.robot, self.context.settings.cloth)
        viewport, message = self.viewport, (self.context.message, self.context.message_color)
        view = (id(shown), viewport.camera, viewport.hover, id(viewport.drag), id(viewport.hand), page.banner())
        line = (*message, status.get("timing"), status.get("controller"))
        return [
            *areas,
            ("view", place.view, view, lambda s: self._draw_view(s, shown)),
            ("status", place.status, line, lambda s: panels.draw_status(s, *message, status)),
            ("camera", place.camera, id(frame), lambda s: viewport.draw_camera(s, frame)),
            ("contact", place.contact, curve, lambda s: draw_contact(s, series, now_s)),
            ("word", place.word, curve, lambda s: draw_word(s, series, now_s)),
        ]

    def _draw_background(self, surface: pygame.Surface) -> None:
        surface.fill(style.BACKGROUND)

    def _draw_top(self, texts: tuple[str, str, str], surface: pygame.Surface) -> None:
        tabs = panels.draw_top(surface, [page.name for page in self.pages], *texts)
        self.tabs = list(zip(tabs, self.pages, strict=True))

    def _draw_key_hints(self, surface: pygame.Surface) -> None:
        hints, corner = self.page.key_hints(), self.context.layout.hints.topleft
        areas = panels.draw_key_hints(surface, hints)
        self.hints = [(area.move(corner), hint.press) for area, hint in zip(areas, hints, strict=False)]

    def _draw_view(self, surface: pygame.Surface, frame: SimulationFrame) -> None:
        surface.fill(style.BACKGROUND)
        self.viewport.draw(surface, frame)
        self.page.draw_over(surface)
        panels.draw_banner(surface, *self.page.banner())

    def _panel_key(self) -> Hashable:
        if self.page.menu is not None:
            # A cursor blinks twice a second.
            return ("menu", id(self.page.menu), self._menu_touched, int(2 * time.monotonic()))
        return (self.page.headline(), tuple(self.page.rows()))

    def _draw_panel(self, surface: pygame.Surface) -> None:
        surface.fill(style.BACKGROUND)
        style.draw_card(surface, surface.get_rect())
        if self.page.menu is not None:
            # A list that has dropped down would darken the whole window, of which only the panel is drawn again.
            self.surface.set_clip(self.context.layout.panel)
            self.page.menu.draw(self.surface)
            self.surface.set_clip(None)
        else:
            panels.draw_rows(surface, self.page.headline(), self.page.rows())
