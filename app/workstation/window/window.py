"""The workstation's window: events in, modes, and everything drawn; only what has changed is drawn again."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Hashable
from pathlib import Path

import pygame

from layflat.app.support.errors import INTERRUPTED
from layflat.app.workstation.session.bench_client import BenchClient, warm
from layflat.app.workstation.session.bench_process import TaskFactory
from layflat.app.workstation.session.frame_channel import BenchFrame
from layflat.app.workstation.teleop import sdl
from layflat.app.workstation.window import panels, settings, style
from layflat.app.workstation.window.input_manager import InputManager
from layflat.app.workstation.window.layout import LEAST, SIZE, layout
from layflat.app.workstation.window.pages import Page, WindowContext, all_pages
from layflat.app.workstation.window.pages.page import ASK_AGAIN_S
from layflat.app.workstation.window.preview import preview
from layflat.app.workstation.window.time_series import draw_contact, draw_word
from layflat.app.workstation.window.viewport import Viewport
from layflat.sim.robots.registry import robot_spec

FRAMES_HZ = 30
REPEAT_MS = (350, 40)
"""A held key: until it repeats, and from then on."""
TITLE = "Layflat"


class Window:
    """The whole program while it is open; ``frame`` does one round, ``run`` all of them."""

    def __init__(
        self,
        folder: Path,
        make: TaskFactory,
        *,
        size: tuple[int, int] = SIZE,
        start: str = "Record",
        remember: bool = True,
    ) -> None:
        """``make`` does a bench process's work; ``remember``: read and write the settings of ``folder``."""
        # No sound is made, and no sound card is to be opened for that.
        os.environ.setdefault("SDL_AUDIODRIVER", "dummy")
        sdl.prepare()
        pygame.init()
        style.fresh()
        pygame.display.set_caption(TITLE)
        self.surface = pygame.display.set_mode(size, pygame.RESIZABLE)
        warm()
        self.shop = WindowContext(
            folder=folder,
            settings=settings.load(folder) if remember else settings.Settings(),
            remember=remember,
            link=BenchClient(make),
            place=layout(self.surface.get_size()),
        )
        self.pane = Viewport()
        self.hands = InputManager(self.shop, self.pane)
        self.modes: list[Page] = all_pages(self.shop, self.hands)
        self.mode = next(mode for mode in self.modes if mode.name == start)
        self.open = True
        self._closed = False
        self._keys_repeat = False
        self.interrupted = False
        self.frames_s: list[float] = []
        """Wall time of the work of each of the last frames."""
        self._painted: dict[str, Hashable] = {}
        self._asked: tuple[str, float] = ("", 0.0)
        self._menu_touched = 0
        self.tabs: list[tuple[pygame.Rect, Page]] = []
        self.chips: list[tuple[pygame.Rect, Callable[[], None] | None]] = []
        self.mode.enter()

    # Rounds

    def run(self, until: Callable[[], bool] = lambda: False) -> int:
        """Until the window is closed, the program interrupted, or ``until`` says so; returns the exit status."""
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
        """Events, what the bench says, what the hands do, and what has changed on the screen."""
        began = time.perf_counter()
        self._repeat_keys()
        self._take(pygame.event.get())
        self.mode.hear(self.shop.link.hear())
        self.hands.put(self.mode)
        self.mode.update()
        self.draw()
        self.frames_s.append(time.perf_counter() - began)
        del self.frames_s[:-200]

    def _repeat_keys(self) -> None:
        """Keys that are held repeat in menus and in a replay; never where each press is a button of a recording."""
        wanted = not self.shop.link.alive
        if wanted != self._keys_repeat:
            self._keys_repeat = wanted
            pygame.key.set_repeat(*(REPEAT_MS if wanted else ()))

    def close(self) -> None:
        """End everything that was started; what is to be kept is on disk afterwards. May be called twice."""
        self.open = False
        if self._closed:
            return
        self._closed = True
        self.mode.leave()
        for mode in self.modes:
            mode.close()
        self.shop.link.end()
        self.hands.close()
        # Not pygame.quit(): pygame-menu keeps its fonts for a next window, and a font without its library crashes.
        pygame.display.quit()

    # Events

    def _take(self, events: list[pygame.event.Event]) -> None:
        rest: list[pygame.event.Event] = []
        for event in events:
            if event.type == pygame.QUIT:
                self.open = False
            elif event.type in (pygame.VIDEORESIZE, pygame.WINDOWSIZECHANGED):
                self._resize()
            elif not (self._clicked(event) or self.hands.take(event) or self._in_view(event)):
                rest.append(event)
        for event in rest:
            menu = self.mode.menu
            if menu is not None:
                # One by one: of a press and its release in one frame a menu would only see the first.
                menu.update([event])
                self._menu_touched += 1
            if menu is None or event.type != pygame.KEYDOWN:
                self.mode.handle(event)

    def _resize(self) -> None:
        width, height = pygame.display.get_surface().get_size()
        size = (max(width, LEAST[0]), max(height, LEAST[1]))
        if size != (width, height):
            pygame.display.set_mode(size, pygame.RESIZABLE)
        self.surface = pygame.display.get_surface()
        self.shop.place = layout(self.surface.get_size())
        self._painted.clear()
        self.mode.relaid()

    def _clicked(self, event: pygame.event.Event) -> bool:
        """Tabs and the buttons of the strip."""
        if event.type != pygame.MOUSEBUTTONDOWN or event.button != 1:
            return False
        for area, mode in self.tabs:
            if area.collidepoint(event.pos):
                self.choose(mode)
                return True
        for area, act in self.chips:
            if area.collidepoint(event.pos) and act is not None:
                act()
                return True
        return False

    def choose(self, mode: Page) -> None:
        """Go to another tab; what runs there is only ended when one asks twice."""
        if mode is self.mode:
            return
        busy = self.mode.busy()
        now = time.monotonic()
        if busy and (self._asked[0] != mode.name or now - self._asked[1] > ASK_AGAIN_S):
            self._asked = (mode.name, now)
            self.shop.say(f"{mode.name} would end {busy}; click again to go there", style.WARNING)
            return
        self.mode.leave()
        self.pane.release()
        self.pane.hover = None
        self.shop.say("")
        self.mode = mode
        self._painted.clear()
        self.mode.enter()

    def _in_view(self, event: pygame.event.Event) -> bool:
        """The mouse over the bench; True where the event has done its service."""
        view, shows = self.shop.place.view, self.mode.shows == "bench"
        if event.type == pygame.MOUSEBUTTONUP and self.pane.dragging:
            self.pane.release()
            return True
        if not shows or event.type not in (pygame.MOUSEBUTTONDOWN, pygame.MOUSEMOTION, pygame.MOUSEWHEEL):
            return False
        pos = pygame.mouse.get_pos() if event.type == pygame.MOUSEWHEEL else event.pos
        at, moment = (pos[0] - view.left, pos[1] - view.top), self.mode.moment()
        if event.type == pygame.MOUSEMOTION and self.pane.dragging:
            self.pane.move(at, event.rel, view.size, moment)
            return True
        if not view.collidepoint(pos) or self.mode.handle(event):
            return view.collidepoint(pos)
        if event.type == pygame.MOUSEWHEEL:
            self.pane.zoom(event.precise_y if hasattr(event, "precise_y") else event.y)
        elif event.type == pygame.MOUSEBUTTONDOWN and event.button in (1, 2, 3):
            self.pane.press(at, event.button, view.size, moment, self.mode.pullable())
        elif event.type == pygame.MOUSEMOTION:
            self.pane.point(at, view.size, moment, self.mode.pullable())
        return True

    # Drawing

    def draw(self) -> None:
        """Areas whose key has changed since they were drawn."""
        changed: list[pygame.Rect] = []
        for name, area, key, paint in self._areas():
            if self._painted.get(name) != key:
                self._painted[name] = key
                paint(self.surface.subsurface(area.clip(self.surface.get_rect())))
                changed.append(area)
        if changed:
            pygame.display.update(changed)

    def _areas(self) -> list[tuple[str, pygame.Rect, Hashable, Callable[[pygame.Surface], None]]]:
        place, mode = self.shop.place, self.mode
        fresh = "all" not in self._painted
        areas: list[tuple[str, pygame.Rect, Hashable, Callable[[pygame.Surface], None]]] = [
            ("all", place.window, place.window.size, self._paint_ground),
            ("top", place.top, panels.top_key(self), lambda s: panels.paint_top(self, s)),
            ("panel", place.panel, self._panel_key(), self._paint_panel),
            ("strip", place.strip, tuple(chip[:2] for chip in mode.chips()), lambda s: panels.paint_strip(self, s)),
        ]
        if mode.shows == "text":
            areas.append(("text", place.text, time.monotonic() if fresh else _tenths(), mode.paint_text))
            return areas
        moment, (history, now_s) = mode.moment(), mode.history()
        curve = (history.episode, len(history.time_s), now_s)
        shown = moment or preview(robot_spec(self.shop.settings.robot).name, self.shop.settings.cloth)
        view = (id(shown), self.pane.orbit, self.pane.hover, id(self.pane.pull), id(self.pane.lead), mode.banner())
        areas += [
            ("view", place.view, view, lambda s: self._paint_view(s, shown)),
            ("status", place.status, panels.status_key(self), lambda s: panels.paint_status(self, s)),
            ("camera", place.camera, id(moment), lambda s: self.pane.paint_camera(s, moment)),
            ("contact", place.contact, curve, lambda s: draw_contact(s, history, now_s)),
            ("word", place.word, curve, lambda s: draw_word(s, history, now_s)),
        ]
        return areas

    def _paint_ground(self, surface: pygame.Surface) -> None:
        surface.fill(style.GROUND)

    def _paint_view(self, surface: pygame.Surface, moment: BenchFrame) -> None:
        surface.fill(style.GROUND)
        self.pane.paint(surface, moment)
        self.mode.paint_over(surface)
        panels.paint_banner(surface, *self.mode.banner())

    def _panel_key(self) -> Hashable:
        if self.mode.menu is not None:
            # A cursor blinks twice a second.
            return ("menu", id(self.mode.menu), self._menu_touched, int(2 * time.monotonic()))
        return (self.mode.headline(), tuple(self.mode.rows()))

    def _paint_panel(self, surface: pygame.Surface) -> None:
        surface.fill(style.GROUND)
        style.card(surface, surface.get_rect())
        if self.mode.menu is not None:
            # A list that has dropped down would darken the whole window, of which only the panel is drawn again.
            self.surface.set_clip(self.shop.place.panel)
            self.mode.menu.draw(self.surface)
            self.surface.set_clip(None)
        else:
            panels.paint_rows(surface, self.mode.headline(), self.mode.rows())


def _tenths() -> int:
    return int(10 * time.monotonic())
