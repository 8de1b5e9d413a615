"""pygame made ready for pads, with a window or without one."""

from __future__ import annotations

import importlib
import os
from typing import Any

from layflat.app.support.errors import LayflatError

SETTINGS = {
    "PYGAME_HIDE_SUPPORT_PROMPT": "1",
    # Or a pad is dead as soon as another window has the focus.
    "SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS": "1",
    # SIGTERM would become an event that nobody waits for.
    "SDL_NO_SIGNAL_HANDLERS": "1",
}


def prepare() -> None:
    """What SDL reads when it starts; call it before pygame is imported."""
    for name, value in SETTINGS.items():
        os.environ.setdefault(name, value)


def load() -> Any:
    """pygame, loaded with these settings."""
    prepare()
    return importlib.import_module("pygame")


def start() -> tuple[Any, Any]:
    """pygame and its controllers, started; pads only speak through an event loop, which needs a display of some kind.

    Where there is no window yet, SDL's dummy display serves: nothing is shown.
    """
    try:
        pygame = load()
        controller = importlib.import_module("pygame._sdl2.controller")
        if not pygame.display.get_init():
            os.environ["SDL_VIDEODRIVER"] = "dummy"
            pygame.display.init()
        pygame.joystick.init()
        controller.init()
    except Exception as error:
        reason = " ".join(str(error).split())
        raise LayflatError(f"pads cannot be read here: {reason}; --source keyboard works without SDL") from error
    return pygame, controller
