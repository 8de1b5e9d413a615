"""The live window of `layflat record`: what it needs, and how it is opened and ends."""

from __future__ import annotations

import os
import re
import socket
import sys
from collections.abc import Callable
from pathlib import Path

from layflat.app.support.errors import LayflatError
from layflat.app.workstation.session.request import SessionRequest
from layflat.app.workstation.session.status import SessionEvent
from layflat.app.workstation.stop_signals import stop_on_signals
from layflat.app.workstation.teleop import sdl

ALTERNATIVES = (
    "without one, use `layflat record --no-window --source keyboard`, `gamepad` or `scripted` in this terminal, or"
    " `layflat app` in a browser"
)
NO_DISPLAY = f"there is no display for a window (DISPLAY and WAYLAND_DISPLAY are not set); {ALTERNATIVES}"
UNSEEN = ("dummy", "offscreen")
X_PORT = 6000
ANSWER_S = 5.0
"""Time in which a display on another machine must answer; one that is switched off would take minutes to fail."""


class NoWindowError(LayflatError):
    """There is no display on which a window could be seen."""


def has_display() -> bool:
    """Return whether a window could be seen."""
    if os.environ.get("SDL_VIDEODRIVER") in UNSEEN:
        return False
    return sys.platform == "darwin" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def run_window(request: SessionRequest, on_event: Callable[[SessionEvent], None], mapping: Path | None = None) -> None:
    """Show a session in a window until it is over or the person closes it, by Ctrl-C and SIGTERM too.

    NoWindowError where there is no display, LayflatError where the session ended by itself.
    """
    with stop_on_signals(impatient=False) as stopped:
        _check_display()
        from layflat.app.workstation.window.window import Window

        window = Window(request, mapping=mapping, on_event=on_event)
        try:
            window.run(stopped)
        finally:
            window.close()
    if window.gone:
        # Everything is saved, and at the program's end pygame would wait for ever for the window's.
        print(window.client.problem, end="", file=sys.stderr)
        sys.stdout.flush()
        os._exit(1 if window.client.problem else 0)
    window.client.check()


def _check_display() -> None:
    """Raise NoWindowError where there is no display, or one that does not answer."""
    if not has_display():
        raise NoWindowError(NO_DISPLAY)
    found = re.fullmatch(r"(?:tcp/)?([^/:]+):(\d+)(?:\.\d+)?", os.environ.get("DISPLAY", ""))
    if found and found[1] != "unix":
        try:
            socket.create_connection((found[1], X_PORT + int(found[2])), timeout=ANSWER_S).close()
        except (OSError, OverflowError, UnicodeError):
            raise _unanswered() from None
    sdl.prepare()
    try:
        import pygame

        from layflat.app.workstation.window.display import ignore_x_errors
    except ImportError as error:
        raise LayflatError(f"the window needs pygame ({error}); run `layflat doctor`") from None
    ignore_x_errors()
    try:
        pygame.display.init()
    except pygame.error as error:
        raise NoWindowError(f"no window can be opened on this display ({error}); {ALTERNATIVES}") from None
    if pygame.display.get_driver() in UNSEEN:
        # SDL would rather draw where nothing is seen than report that a display does not answer.
        pygame.display.quit()
        raise _unanswered()


def _unanswered() -> NoWindowError:
    name = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY", "")
    return NoWindowError(f"the display {name} does not answer; {ALTERNATIVES}")
