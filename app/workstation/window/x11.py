"""Errors of the X server: by default Xlib ends the program where it stands, without its end."""

from __future__ import annotations

import ctypes
from contextlib import suppress

import pygame

_errors = 0


def _note(display: int | None, event: int | None) -> int:
    global _errors  # Xlib's handler has no argument of its own.
    _errors += 1
    return 0


_HANDLER = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)(_note)


def survive_errors() -> None:
    """Note errors instead: a window that was destroyed from outside ends the program as its own X does."""
    global _errors
    _errors = 0
    if pygame.display.get_driver() == "x11":
        with suppress(OSError, AttributeError):
            ctypes.CDLL("libX11.so.6").XSetErrorHandler(_HANDLER)


def window_is_gone() -> bool:
    """Return whether the X server has refused something since `survive_errors`, such as drawing."""
    return _errors > 0
