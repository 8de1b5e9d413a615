"""Start of pygame for gamepads, with or without a window."""

from __future__ import annotations

import ctypes
import importlib
import os
from pathlib import Path
from typing import Any

from layflat.app.support.errors import LayflatError

LABELS = "SDL_GAMECONTROLLER_USE_BUTTON_LABELS"
SETTINGS = {
    "PYGAME_HIDE_SUPPORT_PROMPT": "1",
    # Else a gamepad is dead as soon as another window has the focus.
    "SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS": "1",
    # Else SIGTERM becomes an event that is never read.
    "SDL_NO_SIGNAL_HANDLERS": "1",
    # Name by which desktops group and configure windows.
    "SDL_VIDEO_X11_WMCLASS": "layflat",
}


def prepare() -> None:
    """Set what SDL reads when it starts; call it before pygame is imported."""
    for name, value in SETTINGS.items():
        os.environ.setdefault(name, value)
    # Buttons go by their place: by its labels a Nintendo pad would have keep and discard elsewhere than all others.
    os.environ[LABELS] = "0"


def load() -> Any:
    """Return pygame, loaded with these settings."""
    prepare()
    return importlib.import_module("pygame")


def start() -> tuple[Any, Any]:
    """Start pygame and its controllers and return both.

    Gamepads need an event loop, and that a display: where there is no window yet, SDL's dummy display serves.
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
        raise LayflatError(
            f"gamepads cannot be read here: {reason}; use --source keyboard, which works without SDL"
        ) from error
    return pygame, controller


def library() -> ctypes.CDLL:
    """Return SDL itself, for what pygame has no function for; its modules are linked with it."""
    pygame = load()
    own = Path(pygame.__file__).with_name("SDL2.dll")
    return ctypes.CDLL(str(own) if os.name == "nt" else pygame.joystick.__file__)


def add_mapping(text: str) -> None:
    """Teach SDL the inputs of a kind of gamepad."""
    if library().SDL_GameControllerAddMapping(text.encode()) < 0:
        raise LayflatError(f"SDL refuses the mapping {text}; write one with `layflat gamepad calibrate`")
