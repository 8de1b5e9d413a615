"""`layflat app`, and the window of `layflat record`: what they need, and the window."""

from __future__ import annotations

import os
import re
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from layflat.app.support import validators
from layflat.app.support.errors import LayflatError
from layflat.app.workers.record_config import RecordConfig
from layflat.app.workstation.session.session_queries import next_seeds
from layflat.app.workstation.teleop import sdl
from layflat.policy.trained_model import TrainedModel

if TYPE_CHECKING:
    from layflat.app.workstation.window.window import Window

ALTERNATIVES = (
    "without one, use `layflat record --no-window --source keyboard`, `gamepad` or `scripted`, `train`, `place`,"
    " `replay`, `data` and `demo` in this terminal"
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


def app(folder: Path) -> int:
    """Open the workstation on the sessions and models in ``folder``; return the exit status."""
    validators.writable_folder(folder)
    with open_window(folder) as window:
        return window.run()


@contextmanager
def open_window(folder: Path, **options: Any) -> Iterator[Window]:
    """Open a window, and close it at the end; LayflatError where there can be none."""
    if not has_display():
        raise NoWindowError(NO_DISPLAY)
    _check_display()
    sdl.prepare()
    try:
        import pygame

        from layflat.app.workstation.session.activities import make_activity
        from layflat.app.workstation.window.window import Window
    except ImportError as error:
        raise LayflatError(f"the window needs pygame and pygame-menu ({error}); run `layflat doctor`") from None
    try:
        pygame.display.init()
    except pygame.error as error:
        raise NoWindowError(f"no window can be opened on this display ({error}); {ALTERNATIVES}") from None
    if pygame.display.get_driver() in UNSEEN:
        # SDL would rather draw where nothing is seen than report that a display does not answer.
        pygame.display.quit()
        raise _unanswered()
    window = Window(folder, make_activity, **options)
    try:
        yield window
    finally:
        window.close()


def _check_display() -> None:
    """Raise NoWindowError where the display is on another machine that does not answer."""
    found = re.fullmatch(r"(?:tcp/)?([^/:]+):(\d+)(?:\.\d+)?", os.environ.get("DISPLAY", ""))
    if found and found[1] != "unix":
        try:
            socket.create_connection((found[1], X_PORT + int(found[2])), timeout=ANSWER_S).close()
        except (OSError, OverflowError, UnicodeError):
            raise _unanswered() from None


def _unanswered() -> NoWindowError:
    name = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY", "")
    return NoWindowError(f"the display {name} does not answer; {ALTERNATIVES}")


def record_in_window(config: RecordConfig, model: TrainedModel | None) -> None:
    """Record in a window of its own, which closes when ``config.episodes`` are kept or the person quits.

    One line on stdout for each that is kept or discarded. Only the session is written.
    """
    with open_window(config.path.parent, remember=False) as window:
        page = window.record_page
        window.context.settings = replace(
            window.context.settings,
            robot=config.robot,
            cloth=config.cloth,
            source=config.source,
            descriptor=config.descriptor,
            images=config.images,
            session=config.path.name,
        )
        source = config.source if model is None else f"{model.policy}+{config.source}"
        (page.seed,), _ = next_seeds(config.path, source, 1, config.seed)
        page.episodes, page.disturbance, page.model = config.episodes, config.disturb, model
        page.print_lines = True
        window.input_manager.mapping = config.mapping
        page.start()
        status = window.run(until=lambda: not page.running)
        problem = window.context.client.problem
    if status:
        raise KeyboardInterrupt
    if problem:
        raise LayflatError(problem)
