"""Gamepads that are plugged in: calibrated ones first, then SDL's controllers, then the known raw layouts."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

from layflat.app.support.errors import LayflatError, UsageError
from layflat.app.workstation.teleop import sdl
from layflat.app.workstation.teleop.gamepad_state import BUTTONS, STICKS, TRIGGERS, GamepadState, StickRest, make_state
from layflat.app.workstation.teleop.mapping import (
    RAW_LAYOUTS,
    SDL_NAMES,
    DeviceCapabilities,
    mapping_file,
    raw_layout,
    read_mapping,
    sdl_text,
)

AXIS_MAX = 32767
"""Full deflection of an axis of SDL's controllers."""
UNMOVED = (0, 16383, 16384)
"""Readings of a controller's trigger whose raw axis has not moved yet and reads 0."""
_INPUTS = frozenset(SDL_NAMES.values())
_ADDED: set[str] = set()
"""Kinds of gamepads whose mapping SDL has from here."""


class GamepadDevice:
    """Gamepad whose buttons are known."""

    def __init__(self, pygame: Any, controller: Any, source: str, rest: StickRest) -> None:
        self.source = source
        """Source of the knowledge: "SDL", "calibrated", "raw layout B"."""
        self.name = str(controller.name)
        self.instance = int(controller.as_joystick().get_instance_id())
        """SDL's number for it while it is plugged in."""
        self._pygame, self._controller, self._rest = pygame, controller, rest
        self._moved_triggers: set[str] = set()

    def sticks(self) -> dict[str, float]:
        """Return the raw readings of the sticks, -1..1; to the right and down are positive."""
        return {name: max(self._controller.get_axis(axis) / AXIS_MAX, -1.0) for axis, name in enumerate(STICKS)}

    def state(self) -> GamepadState:
        """Return the state now; a trigger counts as released until it first moves: it may read 0, half pulled."""
        raw = {name: self._controller.get_axis(len(STICKS) + k) for k, name in enumerate(TRIGGERS)}
        self._moved_triggers |= {name for name, value in raw.items() if value not in UNMOVED}
        triggers = {name: value / AXIS_MAX if name in self._moved_triggers else 0.0 for name, value in raw.items()}
        pressed = [name for k, name in enumerate(BUTTONS) if self._controller.get_button(k)]
        return make_state(self.sticks(), triggers, pressed, self._rest)

    def pressed_button(self, event: Any) -> str | None:
        """Return the button whose press this event of the gamepad is, or None."""
        is_press = event.type == self._pygame.CONTROLLERBUTTONDOWN and event.button < len(BUTTONS)
        return BUTTONS[event.button] if is_press else None

    def rumble(self, strength: float, seconds: float) -> bool:
        """Rumble both motors; return False where the gamepad cannot."""
        return bool(self._controller.rumble(strength, strength, int(1000 * seconds)))

    def close(self) -> None:
        """Release it."""
        with contextlib.suppress(self._pygame.error):
            self._controller.quit()


class GamepadRegistry:
    """All gamepads that are plugged in, by SDL's instance numbers; `refresh` notices plugging and unplugging."""

    def __init__(self, pygame: Any, controller: Any, *, mapping: Path | None = None) -> None:
        """Start empty; ``mapping`` is a file for every gamepad that it fits, instead of the user's own."""
        self._pygame, self._controller, self._mapping = pygame, controller, mapping
        self.devices: dict[int, GamepadDevice] = {}
        """Usable gamepads, in the order in which they came."""
        self.unknown: dict[int, str] = {}
        """One sentence for each gamepad that cannot be used."""
        self._open: dict[int, tuple[int, Any]] = {}

    def refresh(self) -> None:
        """Add gamepads that have come and remove those that were disconnected."""
        joysticks = self._joysticks()
        self._open = joysticks  # Else those that are not read would be closed, and opened again each time.
        for instance in [i for i in self.devices if i not in joysticks]:
            self.devices.pop(instance).close()
        self.unknown = {i: sentence for i, sentence in self.unknown.items() if i in joysticks}
        for instance, (index, joystick) in joysticks.items():
            if instance not in self.devices and instance not in self.unknown:
                try:
                    self.devices[instance] = self._make_device(index, joystick)
                except (LayflatError, self._pygame.error) as error:
                    self.unknown[instance] = str(error)

    def _joysticks(self) -> dict[int, tuple[int, Any]]:
        """Return index and joystick by instance number."""
        found = {}
        for index in range(self._pygame.joystick.get_count()):
            with contextlib.suppress(self._pygame.error):  # It may be unplugged between counting and opening.
                joystick = self._pygame.joystick.Joystick(index)
                found[int(joystick.get_instance_id())] = (index, joystick)
        return found

    def _make_device(self, index: int, joystick: Any) -> GamepadDevice:
        has, guid = DeviceCapabilities.of(joystick), joystick.get_guid()
        file = self._mapping or mapping_file(guid)
        mapping, rest = read_mapping(file, has) if self._mapping or file.is_file() else (None, StickRest())
        source = "SDL" if mapping is None else "calibrated"
        if mapping is None and not self._sdl_knows(index, guid, has):
            layout = raw_layout(joystick)
            if layout is None:
                raise LayflatError(
                    f"{joystick.get_name()} ({has.axes} axes, {has.buttons} buttons) is a gamepad that SDL does not"
                    " know; map it with `layflat gamepad calibrate`"
                )
            mapping, source = RAW_LAYOUTS[layout], f"raw layout {layout}"
        if mapping is not None:
            sdl.add_mapping(sdl_text(guid, mapping))
            _ADDED.add(guid)
        return GamepadDevice(self._pygame, self._controller.Controller(index), source, rest)

    def _sdl_knows(self, index: int, guid: str, has: DeviceCapabilities) -> bool:
        """Return whether SDL's own mapping names only inputs that the gamepad has: a guessed one may not."""
        if guid in _ADDED or not self._controller.is_controller(index):
            return False
        known: dict[str, str] = self._controller.Controller(index).get_mapping()
        with contextlib.suppress(UsageError):
            return all(has.has(place.lower()) for name, place in known.items() if name in _INPUTS)
        return True  # Written in a way that SDL may understand.

    def close(self) -> None:
        """Release all of them."""
        for device in self.devices.values():
            device.close()
        self.devices.clear()


def gamepad_events(pygame: Any) -> list[int]:
    """Return the types of events that gamepads send."""
    names = ("BUTTONDOWN", "BUTTONUP", "AXISMOTION", "DEVICEADDED", "DEVICEREMOVED")
    kinds = [getattr(pygame, kind + name) for kind in ("JOY", "CONTROLLER") for name in names]
    return [*kinds, pygame.JOYHATMOTION, pygame.JOYBALLMOTION, pygame.CONTROLLERDEVICEREMAPPED]
