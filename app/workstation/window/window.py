"""Window: the live view of one session; events in, pictures out."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import pygame

from layflat.app.workstation.session.client import SessionClient
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.session.status import SessionEvent
from layflat.app.workstation.teleop import sdl
from layflat.app.workstation.window import display, remote, style
from layflat.app.workstation.window.contents import VIEW_KEYS, Contents, Inputs
from layflat.app.workstation.window.ghost import Ghost
from layflat.app.workstation.window.orbit_camera import PRESETS
from layflat.app.workstation.window.painter import Painter

FRAMES_HZ = 30
ZOOM, ZOOM_RANGE = 1.1, (0.6, 3.0)


class Window:
    """The whole program while it is open: ``frame`` runs one round, ``run`` all of them."""

    def __init__(
        self, request: SessionRequest, *, mapping: Path | None = None, on_event: Callable[[SessionEvent], None]
    ) -> None:
        """Open the window and start the session; ``on_event`` gets what must be shown once."""
        sdl.prepare()
        remote.prepare()
        pygame.display.init()
        pygame.font.init()
        style.clear_cache()
        self.memory, self._display_scale = display.load_memory(), display.display_scale()
        pygame.display.set_caption(f"Layflat: {request.session.name if request.session else 'live'}")
        pygame.display.set_icon(icon())
        surface = pygame.display.set_mode(display.first_size(self.memory, self._display_scale), pygame.RESIZABLE)
        self._x = display.XConnection()
        self.open = True
        self.gone = False
        """Whether the window was destroyed from outside; SDL would wait for ever for its end."""
        self.frames_s: list[float] = []
        """Wall time of the work of each of the last frames."""
        self._on_event = on_event
        self._closed = False
        self.client, self.ghost = SessionClient(), Ghost(request.session)
        self.inputs = Inputs(request, self.client, mapping)
        self.inputs.tone.on = self.memory.sound
        self.contents = Contents(request, self.client, self.inputs, self.ghost, self._actions())
        self.painter = Painter(surface, self.contents, self._display_scale * self.memory.zoom)
        self.painter.draw()  # The session takes a second to start.
        self.client.start(request)

    # Rounds

    def run(self, stopped: Callable[[], bool]) -> None:
        """Run until the window is closed, the session is over, or ``stopped`` returns True."""
        clock = pygame.time.Clock()
        while self.open and not stopped():
            self.frame()
            clock.tick(FRAMES_HZ)
        self.close()

    def _stop(self) -> None:
        self.open = False

    def frame(self) -> None:
        """Handle events of the window and the session, send the input, and draw what has changed."""
        began = time.perf_counter()
        for event in pygame.event.get():
            self._handle_event(event)
        self._report(self.client.poll())
        if self.client.alive:
            self.inputs.send()
        self.contents.update()
        self.gone = self.gone or self._x.window_is_gone()
        if self.client.status.state == "over" or not self.client.alive or self.gone:
            self.open = False
        if self.open:
            self.painter.draw()
        self.frames_s.append(time.perf_counter() - began)
        del self.frames_s[:-200]

    def _report(self, events: list[SessionEvent]) -> None:
        for event in events:
            self._on_event(event)

    def close(self) -> None:
        """End the session with everything saved durably; may be called twice."""
        self.open = False
        if self._closed:
            return
        self._closed = True
        self._report(self.client.end())
        self.inputs.close()
        display.save_memory(self.memory)
        self._x.close()
        if not self.gone:
            pygame.display.quit()

    # Events

    def _handle_event(self, event: pygame.event.Event) -> None:
        if event.type in (pygame.QUIT, pygame.WINDOWCLOSE):
            self.open = False
        elif event.type in (pygame.VIDEORESIZE, pygame.WINDOWSIZECHANGED):
            self._resize()
        elif event.type in (pygame.WINDOWEXPOSED, pygame.WINDOWRESTORED):
            self.painter.forget()
        elif not (self._click(event) or self._key(event) or self.inputs.handle_event(event)):
            inputs = self.inputs
            inputs.viewport.handle_mouse(event, inputs.view, inputs.scale, self.client.frame, inputs.can_drag())

    def _actions(self) -> dict[str, Callable[[], None]]:
        return {
            "sound": self.toggle_sound,
            "ghost": self.ghost.toggle,
            "full screen": self._toggle_full_screen,
            "end": self._stop,
            **{name: partial(self.look, name) for name in VIEW_KEYS.values()},
        }

    def _key(self, event: pygame.event.Event) -> bool:
        """Handle a key of the window, which no device uses; return whether it is one."""
        if event.type != pygame.KEYDOWN:
            return False
        larger, smaller = partial(self.zoom, ZOOM), partial(self.zoom, 1 / ZOOM)
        actions = self.contents.actions
        keys = {pygame.K_ESCAPE: "end", pygame.K_m: "sound", pygame.K_g: "ghost", pygame.K_F11: "full screen"}
        found: dict[int, Callable[[], None]] = {key: actions[name] for key, name in (keys | VIEW_KEYS).items()}
        if event.mod & pygame.KMOD_CTRL:
            found = {pygame.K_q: self._stop, pygame.K_w: self._stop, pygame.K_0: partial(self.zoom, 0.0)}
            found |= dict.fromkeys((pygame.K_PLUS, pygame.K_EQUALS, pygame.K_KP_PLUS), larger)
            found |= dict.fromkeys((pygame.K_MINUS, pygame.K_KP_MINUS), smaller)
        elif event.mod & pygame.KMOD_ALT:
            found = {pygame.K_F4: self._stop}
        action = found.get(event.key)
        if action is not None:
            action()
        return action is not None

    def look(self, name: str) -> None:
        """Look from a preset."""
        self.inputs.viewport.camera = PRESETS[name]

    def toggle_sound(self) -> None:
        """Turn the tone at contact on or off."""
        self.inputs.tone.on = not self.inputs.tone.on
        self.memory = replace(self.memory, sound=self.inputs.tone.on)
        if self.inputs.tone.on:
            self.inputs.tone.play()

    def _toggle_full_screen(self) -> None:
        pygame.display.toggle_fullscreen()
        self._resize()

    def zoom(self, factor: float) -> None:
        """Make the letters larger by a factor; 0: as large as the display's scale says."""
        low, high = ZOOM_RANGE
        self.memory = replace(self.memory, zoom=min(max(self.memory.zoom * factor, low), high) if factor else 1.0)
        self._resize()

    def _resize(self) -> None:
        surface = pygame.display.get_surface()
        if not pygame.display.is_fullscreen():
            self.memory = replace(self.memory, width=surface.get_width(), height=surface.get_height())
        self.painter.resize(surface, self._display_scale * self.memory.zoom)

    def _click(self, event: pygame.event.Event) -> bool:
        """Handle a click on a key chip."""
        if event.type != pygame.MOUSEBUTTONDOWN or event.button != 1:
            return False
        for area, hint in self.painter.hints:
            if area.collidepoint(event.pos) and hint.press is not None:
                hint.press()
                return True
        return False


def icon() -> pygame.Surface:
    """Return a picture of a cloth that is laid."""
    picture = pygame.Surface((64, 64), pygame.SRCALPHA)
    pygame.draw.polygon(picture, style.ACCENT, [(6, 46), (22, 22), (58, 22), (44, 46)])
    pygame.draw.polygon(picture, style.CONTACT, [(6, 46), (16, 30), (52, 30), (44, 46)])
    pygame.draw.line(picture, style.TEXT, (2, 50), (62, 50), 4)
    return picture
