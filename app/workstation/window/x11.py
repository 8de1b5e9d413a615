"""A window that was destroyed from outside: by default Xlib then ends the program where it stands."""

from __future__ import annotations

import ctypes
import time
from contextlib import suppress
from typing import Any

import pygame

LOOK_S = 0.5
"""Time between two looks whether the window is still there."""
ATTRIBUTES_BYTES = 1024
"""More than Xlib's XWindowAttributes."""


_IGNORE = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)(lambda *_: 0)


def ignore_errors() -> None:
    """Ignore errors of the X server; before SDL starts, which passes them on to the handler that it found."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL("libX11.so.6").XSetErrorHandler(_IGNORE)


class XWatch:
    """Asks the X server whether the window is there, through a connection of its own."""

    def __init__(self) -> None:
        """Watch the window of pygame's display, where that is on an X server."""
        self._x11: Any = None
        self._looked_s = time.monotonic()
        if pygame.display.get_driver() == "x11":
            with suppress(OSError, AttributeError, KeyError):
                x11 = ctypes.CDLL("libX11.so.6")
                x11.XOpenDisplay.restype = ctypes.c_void_p
                self._display = ctypes.c_void_p(x11.XOpenDisplay(None))
                self._window = ctypes.c_ulong(pygame.display.get_wm_info()["window"])
                self._attributes = ctypes.create_string_buffer(ATTRIBUTES_BYTES)
                self._x11 = x11 if self._display else None

    def window_is_gone(self) -> bool:
        """Return whether the X server has no such window any more."""
        if self._x11 is None or time.monotonic() - self._looked_s < LOOK_S:
            return False
        self._looked_s = time.monotonic()
        return not self._x11.XGetWindowAttributes(self._display, self._window, self._attributes)

    def close(self) -> None:
        """Close the connection."""
        if self._x11 is not None:
            self._x11.XCloseDisplay(self._display)
        self._x11 = None
