"""The display: how dense it is, whether a window on it is still there, and what a window remembers for the next one."""

from __future__ import annotations

import ctypes
import json
import os
import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import platformdirs
import pygame

from layflat.app.workstation.teleop import sdl
from layflat.data.atomic_files import write_text

SIZE = (1280, 760)
"""First size of the window at scale 1, px."""
BASE_DPI, STEP, MAX_SCALE = 96.0, 0.25, 4.0
FRAME_PX, EDGE_PX = 44, 8
"""Height of a title bar at scale 1, and width of a window's edges, which a window leaves free."""
UNSEEN = ("dummy", "offscreen")
LOOK_S = 0.5
"""Time between two looks whether the window is still there."""
ATTRIBUTES_BYTES = 1024
"""More than Xlib's XWindowAttributes."""
_IGNORE = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)(lambda *_: 0)


def ignore_x_errors() -> None:
    """Ignore errors of the X server; before SDL starts, which passes them on to the handler that it found.

    By default Xlib ends the program where it stands when its window was destroyed from outside.
    """
    with suppress(OSError, AttributeError):
        ctypes.CDLL("libX11.so.6").XSetErrorHandler(_IGNORE)


class XConnection:
    """A connection of its own to the X server on which pygame's display is; there is none on other displays."""

    def __init__(self) -> None:
        self._x11: Any = None
        self._looked_s = time.monotonic()
        if os.environ.get("DISPLAY") and pygame.display.get_driver() == "x11":
            with suppress(OSError, AttributeError):
                x11 = ctypes.CDLL("libX11.so.6")
                x11.XOpenDisplay.restype, x11.XGetDefault.restype = ctypes.c_void_p, ctypes.c_char_p
                self._display = ctypes.c_void_p(x11.XOpenDisplay(None))
                self._x11 = x11 if self._display else None

    def dpi(self) -> float:
        """Return Xft.dpi, in which desktops keep their scale, or the server's dpi; 0 where they say nothing of it."""
        if self._x11 is None:
            return 0.0
        found = self._x11.XGetDefault(self._display, b"Xft", b"dpi")
        with suppress(ValueError):
            if found:
                return float(found)
        width_mm = self._x11.XDisplayWidthMM(self._display, 0)
        dpi = 25.4 * self._x11.XDisplayWidth(self._display, 0) / width_mm if width_mm else 0.0
        return dpi if round(dpi) != BASE_DPI else 0.0  # Servers that do not know their display say 96.

    def window_is_gone(self) -> bool:
        """Return whether the server has no window of pygame any more."""
        if self._x11 is None or time.monotonic() - self._looked_s < LOOK_S:
            return False
        self._looked_s = time.monotonic()
        window = ctypes.c_ulong(pygame.display.get_wm_info()["window"])
        attributes = ctypes.create_string_buffer(ATTRIBUTES_BYTES)
        return not self._x11.XGetWindowAttributes(self._display, window, attributes)

    def close(self) -> None:
        """Close the connection."""
        if self._x11 is not None:
            self._x11.XCloseDisplay(self._display)
        self._x11 = None


def display_scale() -> float:
    """Return by how much letters are larger than at 96 dpi: the desktop's own setting, or else the display's dpi."""
    x = XConnection()
    dpi, by_sdl = x.dpi(), ctypes.c_float()
    x.close()
    with suppress(OSError, AttributeError):
        if not dpi and sdl.library().SDL_GetDisplayDPI(0, ctypes.byref(by_sdl), None, None) == 0:
            dpi = by_sdl.value
    return min(max(round(dpi / BASE_DPI / STEP) * STEP, 1.0), MAX_SCALE) if dpi else 1.0


@dataclass(frozen=True)
class WindowMemory:
    """Settings that a window leaves for the next one."""

    width: int = 0
    """Size in px; 0: not known yet."""
    height: int = 0
    zoom: float = 1.0
    """Factor of the person on the display's scale."""
    sound: bool = True


def memory_file() -> Path:
    """Return the file of WindowMemory, in the person's settings."""
    return Path(platformdirs.user_config_dir("layflat")) / "window.json"


def load_memory() -> WindowMemory:
    """Return what the last window left; the defaults where nothing can be read."""
    with suppress(OSError, ValueError, TypeError):
        values: dict[str, Any] = json.loads(memory_file().read_text())
        known = asdict(WindowMemory())
        found = WindowMemory(**{name: type(default)(values.get(name, default)) for name, default in known.items()})
        if min(found.width, found.height) >= 0 and 0.5 <= found.zoom <= 3.0:
            return found
    return WindowMemory()


def save_memory(memory: WindowMemory) -> None:
    """Write it for the next window, where that is possible."""
    with suppress(OSError):
        memory_file().parent.mkdir(parents=True, exist_ok=True)
        write_text(memory_file(), json.dumps(asdict(memory)) + "\n")


def first_size(memory: WindowMemory, scale: float) -> tuple[int, int]:
    """Return the size of a new window: the last one's, or the usual one, within the desktop and without its bars."""
    known = memory.width and memory.height
    wide, high = (memory.width, memory.height) if known else (round(SIZE[0] * scale), round(SIZE[1] * scale))
    if pygame.display.get_driver() in UNSEEN:
        return wide, high
    desktop = pygame.display.get_desktop_sizes()[0]
    return min(wide, desktop[0] - EDGE_PX), min(high, desktop[1] - round(FRAME_PX * scale))
