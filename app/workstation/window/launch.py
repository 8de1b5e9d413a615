"""`layflat app`, and the window of `layflat record`: what they need, and the window."""

from __future__ import annotations

import os
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
    "without one, use `layflat record --source keyboard`, `gamepad` or `scripted`, `train`, `place`, `replay`, `data`"
    " and `demo` in this terminal"
)
NO_DISPLAY = f"there is no display for a window (DISPLAY and WAYLAND_DISPLAY are not set); {ALTERNATIVES}"
UNSEEN = ("dummy", "offscreen")


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
        raise LayflatError(NO_DISPLAY)
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
        raise LayflatError(f"no window can be opened on this display ({error}); {ALTERNATIVES}") from None
    if pygame.display.get_driver() in UNSEEN:
        # SDL would rather draw where nothing is seen than report that a display does not answer.
        raise LayflatError(f"the display {os.environ.get('DISPLAY', '')} does not answer; {ALTERNATIVES}")
    window = Window(folder, make_activity, **options)
    try:
        yield window
    finally:
        window.close()


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
