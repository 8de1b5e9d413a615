"""`layflat app`, and the window of `layflat record`: what must be there, and the window."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from layflat.app.support import validators
from layflat.app.support.errors import LayflatError
from layflat.app.workers.record_config import RecordConfig
from layflat.app.workstation.session.teleop_record import has_display
from layflat.app.workstation.teleop import sdl

if TYPE_CHECKING:
    from layflat.app.workstation.window.window import Window

ALTERNATIVES = (
    "without one `layflat record --source keyboard`, `gamepad` and `scripted`, `train`, `place`, `replay`, `data` and"
    " `demo` do the same in this terminal"
)
NO_DISPLAY = f"there is no display for a window (DISPLAY and WAYLAND_DISPLAY are not set); {ALTERNATIVES}"
UNSEEN = ("dummy", "offscreen")


def app(folder: Path) -> int:
    """Open the workstation on the sessions and models in ``folder``; returns the exit status."""
    validators.writable_folder(folder)
    with opened(folder) as window:
        return window.run()


@contextmanager
def opened(folder: Path, **options: Any) -> Iterator[Window]:
    """A window; LayflatError where there can be none. It is closed at the end, whatever happens."""
    if not has_display():
        raise LayflatError(NO_DISPLAY)
    sdl.prepare()
    try:
        import pygame

        from layflat.app.workstation.session.tasks import make_task
        from layflat.app.workstation.window.window import Window
    except ImportError as error:
        raise LayflatError(f"the window needs pygame and pygame-menu ({error}); run `layflat doctor`") from None
    try:
        pygame.display.init()
    except pygame.error as error:
        raise LayflatError(f"no window can be opened on this display ({error}); {ALTERNATIVES}") from None
    if pygame.display.get_driver() in UNSEEN:
        # SDL would rather draw where nobody sees it than say that a display does not answer.
        raise LayflatError(f"the display {os.environ.get('DISPLAY', '')} does not answer; {ALTERNATIVES}")
    window = Window(folder, make_task, **options)
    try:
        yield window
    finally:
        window.close()


def record_in_window(wish: RecordConfig) -> None:
    """Record in a window of its own, which closes when ``wish.episodes`` are kept or the person quits.

    One line on stdout for each that is kept or discarded. Nothing but the session is written.
    """
    from layflat.app.workstation.session.recording_session import COUNTDOWN_S
    from layflat.app.workstation.window.pages.record import RecordPage

    with opened(wish.path.parent, remember=False) as window:
        mode = window.mode
        if not isinstance(mode, RecordPage):
            raise TypeError(f"the window opens with {mode.name}, not with its recording")
        window.shop.settings = replace(
            window.shop.settings,
            robot=wish.robot,
            cloth=wish.cloth,
            source=wish.source,
            descriptor=wish.descriptor,
            images=wish.images,
            countdown_s=COUNTDOWN_S,
            session=wish.path.name,
        )
        mode.seed, mode.episodes, mode.disturbance, mode.echo = wish.seed, wish.episodes, wish.disturb, True
        mode.correct = "" if wish.correct is None else str(wish.correct)
        window.hands.mapping = wish.mapping
        mode.start()
        status = window.run(until=lambda: not mode.running)
        sentence = window.shop.link.sentence
    if status:
        raise KeyboardInterrupt
    if sentence:
        raise LayflatError(sentence)
