"""A pad without hardware: SDL's own virtual joystick, which to SDL (and so to pygame) is a device like any other.

It only exists in the process that makes it. ``known`` ones SDL maps as a controller, others it leaves raw.
"""

from __future__ import annotations

import ctypes
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from layflat.app.workstation.teleop import sdl

CONTROLLER, UNKNOWN = 1, 0
"""SDL_JOYSTICK_TYPE_GAMECONTROLLER, SDL_JOYSTICK_TYPE_UNKNOWN."""
FULL = 32767
NAME = "Virtual PS4 pad"
SONY, DUALSHOCK_4 = 0x054C, 0x09CC
_FACE = ("cross", "circle", "square", "triangle", "share", "ps", "options", "l3", "r3", "l1", "r1")
_ALL = (*_FACE, "up", "down", "left", "right", "touchpad")
BUTTONS_OF_A = {name: index for index, name in enumerate(_ALL)}
AXES_OF_A = {name: index for index, name in enumerate(("left_x", "left_y", "right_x", "right_y", "l2", "r2"))}

_RUMBLE = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_uint16, ctypes.c_uint16)
_POINTERS = ("userdata", "Update", "SetPlayerIndex")


class _Description(ctypes.Structure):
    """SDL_VirtualJoystickDesc, version 1 (SDL 2.24 and later)."""

    _fields_ = [
        *((name, ctypes.c_uint16) for name in ("version", "type", "naxes", "nbuttons", "nhats", "vendor", "product")),
        ("padding", ctypes.c_uint16),
        ("button_mask", ctypes.c_uint32),
        ("axis_mask", ctypes.c_uint32),
        ("name", ctypes.c_char_p),
        *((name, ctypes.c_void_p) for name in _POINTERS),
        ("Rumble", _RUMBLE),
        *((name, ctypes.c_void_p) for name in ("RumbleTriggers", "SetLED", "SendEffect")),
    ]


def library() -> ctypes.CDLL:
    """The SDL that pygame ships."""
    pygame, _ = sdl.start()
    shipped = Path(pygame.__file__).parent
    (path,) = [*shipped.parent.glob("pygame.libs/libSDL2-2*"), *shipped.glob(".dylibs/libSDL2-2*")]
    found = ctypes.CDLL(str(path))
    pointer = ctypes.c_void_p
    found.SDL_JoystickOpen.restype = pointer
    found.SDL_JoystickClose.argtypes = [pointer]
    found.SDL_JoystickInstanceID.argtypes = [pointer]
    found.SDL_JoystickSetVirtualAxis.argtypes = [pointer, ctypes.c_int, ctypes.c_int16]
    found.SDL_JoystickSetVirtualButton.argtypes = [pointer, ctypes.c_int, ctypes.c_uint8]
    found.SDL_JoystickSetVirtualHat.argtypes = [pointer, ctypes.c_int, ctypes.c_uint8]
    found.SDL_GetError.restype = ctypes.c_char_p
    return found


class VirtualPad:
    """One pad, plugged in from the moment it is made until ``unplug``."""

    def __init__(
        self, axes: int = 6, buttons: int = 16, hats: int = 0, *, known: bool = True, name: str = NAME
    ) -> None:
        self._sdl = library()
        self.rumbles: list[tuple[int, int]] = []
        """(low, high) motor, each 0..65535, of each call."""
        self._rumble = _RUMBLE(self._on_rumble)
        description = _Description(
            version=1,
            type=CONTROLLER if known else UNKNOWN,
            naxes=axes,
            nbuttons=buttons,
            nhats=hats,
            vendor=SONY,
            # SDL keeps a mapping, name included, for each product.
            product=DUALSHOCK_4 if name == NAME else zlib.crc32(name.encode()) & 0xFFFF,
            name=name.encode(),
            Rumble=self._rumble,
        )
        index = self._sdl.SDL_JoystickAttachVirtualEx(ctypes.byref(description))
        if index < 0:
            raise RuntimeError(f"SDL makes no virtual joystick: {self._sdl.SDL_GetError().decode()}")
        self._joystick = self._sdl.SDL_JoystickOpen(index)
        self.instance = self._sdl.SDL_JoystickInstanceID(self._joystick)
        self.plugged = True

    def axis(self, which: int | str, value: float) -> None:
        """-1..1; by number, or by its name in layout A."""
        number = AXES_OF_A[which] if isinstance(which, str) else which
        raw = max(-FULL - 1, min(FULL, round(value * FULL)))
        self._done(self._sdl.SDL_JoystickSetVirtualAxis(self._joystick, number, raw))

    def button(self, which: int | str, down: bool) -> None:
        number = BUTTONS_OF_A[which] if isinstance(which, str) else which
        self._done(self._sdl.SDL_JoystickSetVirtualButton(self._joystick, number, int(down)))

    def hat(self, number: int, x: int, y: int) -> None:
        """-1, 0 or 1 each; up is positive, as pygame has it."""
        value = (1 if y > 0 else 4 if y < 0 else 0) | (2 if x > 0 else 8 if x < 0 else 0)
        self._done(self._sdl.SDL_JoystickSetVirtualHat(self._joystick, number, value))

    def tap(self, which: int | str) -> None:
        """Down and up again, each seen by SDL."""
        for down in (True, False):
            self.button(which, down)
            self._sdl.SDL_JoystickUpdate()

    def unplug(self) -> None:
        if not self.plugged:
            return
        self.plugged = False
        for index in range(self._sdl.SDL_NumJoysticks()):
            if self._sdl.SDL_JoystickGetDeviceInstanceID(index) == self.instance:
                self._done(self._sdl.SDL_JoystickDetachVirtual(index))
                break
        self._sdl.SDL_JoystickClose(self._joystick)

    def _on_rumble(self, _: object, low: int, high: int) -> int:
        self.rumbles.append((low, high))
        return 0

    def _done(self, status: int) -> None:
        if status < 0:
            raise RuntimeError(f"SDL refuses: {self._sdl.SDL_GetError().decode()}")


@contextmanager
def plugged(*counts: int, known: bool = True, name: str = NAME) -> Iterator[VirtualPad]:
    """``with plugged(6, 16, 0) as pad``"""
    pad = VirtualPad(*counts, known=known, name=name)
    try:
        yield pad
    finally:
        pad.unplug()
