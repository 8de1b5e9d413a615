"""Scale of the display, and what the window remembers: its size, the size of its letters, and sound on or off."""

from __future__ import annotations

import ctypes
import json
import os
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import platformdirs
import pygame

from layflat.app.workstation.window.layout import SIZE
from layflat.data.atomic_files import write_text

BASE_DPI = 96.0
STEP = 0.25
MAX_SCALE = 4.0
FRAME_PX, EDGE_PX = 44, 8
"""Height of a title bar at scale 1, and width of a window's edges, which a window leaves free."""
UNSEEN = ("dummy", "offscreen")


def display_scale() -> float:
    """Return by how much letters are larger than at 96 dpi: the desktop's own setting, or else the display's dpi."""
    dpi = _desktop_dpi() or _display_dpi()
    return min(max(round(dpi / BASE_DPI / STEP) * STEP, 1.0), MAX_SCALE) if dpi else 1.0


def _desktop_dpi() -> float:
    """Return Xft.dpi, in which desktops keep their scale, or the X server's dpi; 0 where they say nothing of it."""
    if not os.environ.get("DISPLAY") or pygame.display.get_driver() != "x11":
        return 0.0
    with suppress(OSError, AttributeError, ValueError):
        x11 = ctypes.CDLL("libX11.so.6")
        x11.XOpenDisplay.restype, x11.XGetDefault.restype = ctypes.c_void_p, ctypes.c_char_p
        display = ctypes.c_void_p(x11.XOpenDisplay(None))
        if display:
            found = x11.XGetDefault(display, b"Xft", b"dpi")
            width_mm = x11.XDisplayWidthMM(display, 0)
            dpi = 25.4 * x11.XDisplayWidth(display, 0) / width_mm if width_mm else 0.0
            x11.XCloseDisplay(display)
            # Servers that do not know their display say 96.
            return float(found) if found else dpi if round(dpi) != BASE_DPI else 0.0
    return 0.0


def _display_dpi() -> float:
    """Return the display's dots per inch, as SDL knows it; 0 where it does not."""
    dpi = ctypes.c_float()
    with suppress(OSError, AttributeError):
        # pygame has no function for it; its module is linked with SDL.
        sdl = ctypes.CDLL(pygame.display.__file__)
        if sdl.SDL_GetDisplayDPI(0, ctypes.byref(dpi), None, None) == 0:
            return float(dpi.value)
    return 0.0


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
    wide, high = (memory.width, memory.height) if memory.width and memory.height else SIZE
    if not (memory.width and memory.height):
        wide, high = round(wide * scale), round(high * scale)
    if pygame.display.get_driver() in UNSEEN:
        return wide, high
    desktop = pygame.display.get_desktop_sizes()[0]
    return min(wide, desktop[0] - EDGE_PX), min(high, desktop[1] - round(FRAME_PX * scale))
