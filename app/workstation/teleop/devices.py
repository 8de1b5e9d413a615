"""Gamepads that are plugged in: calibrated ones first, then SDL's controllers, then the known raw layouts."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from layflat.app.support.errors import LayflatError
from layflat.app.workstation.teleop.gamepad_state import BUTTONS, STICKS, TRIGGERS, GamepadState, StickRest, make_state
from layflat.app.workstation.teleop.layouts import Binding, DeviceCapabilities, GamepadLayout, raw_layout
from layflat.app.workstation.teleop.mapping import mapping_file, read_settings

AXIS_MAX = 32767
"""Full deflection of an axis of SDL's controllers."""
UNMOVED = (0, 16383, 16384)
"""Readings of a controller's trigger whose raw axis has not moved yet and reads 0."""


class GamepadDevice:
    """Base of gamepads whose buttons are known."""

    def __init__(self, pygame: Any, joystick: Any, device: Any, source: str, rest: StickRest) -> None:
        """Use ``device``, which is the joystick itself or SDL's controller on top of it."""
        self.rest = rest
        self.source = source
        """Source of the knowledge: "SDL", "calibrated", "raw layout B"."""
        self.name = str(joystick.get_name() if device is joystick else device.name)
        self.instance = int(joystick.get_instance_id())
        """SDL's number for it while it is plugged in."""
        self._pygame = pygame
        self._device = device
        self._moved_triggers: set[str] = set()

    def state(self) -> GamepadState:
        """Return the state now."""
        raise NotImplementedError

    def sticks(self) -> dict[str, float]:
        """Return the raw readings of the sticks, -1..1; to the right and down are positive."""
        raise NotImplementedError

    def pressed_button(self, event: Any) -> str | None:
        """Return the button whose press this event of the gamepad is, or None."""
        raise NotImplementedError

    def rumble(self, strength: float, seconds: float) -> bool:
        """Rumble both motors; return False where the gamepad cannot."""
        return bool(self._device.rumble(strength, strength, int(1000 * seconds)))

    def close(self) -> None:
        """Release it."""
        with contextlib.suppress(self._pygame.error):
            self._device.quit()

    def _trigger_value(self, name: str, value: float, *, unmoved: bool) -> float:
        """Count a trigger as released until it first moves: before that it may read 0, which is half pulled."""
        if unmoved and name not in self._moved_triggers:
            return 0.0
        self._moved_triggers.add(name)
        return value


class ControllerDevice(GamepadDevice):
    """Gamepad that SDL's database knows."""

    def __init__(self, pygame: Any, controller: Any, rest: StickRest) -> None:
        super().__init__(pygame, controller.as_joystick(), controller, "SDL", rest)

    def sticks(self) -> dict[str, float]:
        """Return the raw readings of the sticks."""
        return {name: max(self._device.get_axis(axis) / AXIS_MAX, -1.0) for axis, name in enumerate(STICKS)}

    def state(self) -> GamepadState:
        """Return the state now."""
        raw = [self._device.get_axis(len(STICKS) + k) for k in range(len(TRIGGERS))]
        triggers = {
            name: self._trigger_value(name, value / AXIS_MAX, unmoved=value in UNMOVED)
            for name, value in zip(TRIGGERS, raw, strict=True)
        }
        pressed = [name for k, name in enumerate(BUTTONS) if self._device.get_button(k)]
        return make_state(self.sticks(), triggers, pressed, self.rest)

    def pressed_button(self, event: Any) -> str | None:
        """Return the button whose press this event is, or None."""
        if event.type == self._pygame.CONTROLLERBUTTONDOWN and event.button < len(BUTTONS):
            return BUTTONS[event.button]
        return None


class RawGamepad(GamepadDevice):
    """Gamepad whose buttons a layout names."""

    def __init__(self, pygame: Any, joystick: Any, layout: GamepadLayout, source: str, rest: StickRest) -> None:
        super().__init__(pygame, joystick, joystick, source, rest)
        self._layout = layout

    def sticks(self) -> dict[str, float]:
        """Return the raw readings of the sticks."""
        return {name: sign * self._device.get_axis(axis) for name, (axis, sign) in self._layout.sticks.items()}

    def state(self) -> GamepadState:
        """Return the state now."""
        triggers = {name: self._trigger(name) for name in self._layout.triggers}
        pressed = [name for name, binding in self._layout.buttons.items() if binding.is_pressed(self._device)]
        return make_state(self.sticks(), triggers, pressed, self.rest)

    def _trigger(self, name: str) -> float:
        trigger = self._layout.triggers[name]
        if isinstance(trigger, Binding):
            return float(trigger.is_pressed(self._device))
        raw = self._device.get_axis(trigger.axis)
        return self._trigger_value(name, trigger.value(raw), unmoved=raw == 0 and trigger.rest != 0)

    def pressed_button(self, event: Any) -> str | None:
        """Return the button whose press this event is, or None."""
        texts = []
        if event.type == self._pygame.JOYBUTTONDOWN:
            texts = [f"b{event.button}"]
        elif event.type == self._pygame.JOYHATMOTION:
            ways = zip("xy", event.value, strict=True)
            texts = [f"h{event.hat}.{axis}{'+' if value > 0 else '-'}" for axis, value in ways if value]
        return next((name for name, binding in self._layout.buttons.items() if binding.text in texts), None)


class GamepadRegistry:
    """All gamepads that are plugged in, by SDL's instance numbers; `refresh` notices plugging and unplugging."""

    def __init__(self, pygame: Any, controller: Any, *, mapping: Path | None = None) -> None:
        """Start empty; ``mapping`` is a file for every gamepad that it fits, instead of the user's own."""
        self._pygame = pygame
        self._controller = controller
        self._mapping = mapping
        self.devices: dict[int, GamepadDevice] = {}
        """Usable gamepads, in the order in which they came."""
        self._open: dict[int, tuple[int, Any]] = {}
        self.unknown: dict[int, str] = {}
        """One sentence for each gamepad that cannot be used."""

    def refresh(self) -> None:
        """Add gamepads that have come and remove those that were disconnected."""
        joysticks = self._joysticks()
        self._open = joysticks  # Else those that are not read would be closed, and opened again each time.
        for instance in [i for i in self.devices if i not in joysticks]:
            self.devices.pop(instance).close()
        for instance in [i for i in self.unknown if i not in joysticks]:
            del self.unknown[instance]
        for instance, (index, joystick) in joysticks.items():
            if instance not in self.devices and instance not in self.unknown:
                self._add(instance, index, joystick)

    def _joysticks(self) -> dict[int, tuple[int, Any]]:
        """Return index and joystick by instance number."""
        found = {}
        for index in range(self._pygame.joystick.get_count()):
            with contextlib.suppress(self._pygame.error):  # It may be unplugged between counting and opening.
                joystick = self._pygame.joystick.Joystick(index)
                found[int(joystick.get_instance_id())] = (index, joystick)
        return found

    def _add(self, instance: int, index: int, joystick: Any) -> None:
        try:
            device = self._make_device(index, joystick)
        except (LayflatError, self._pygame.error) as error:
            self.unknown[instance] = str(error)
            return
        if device is not None:
            self.devices[instance] = device
            return
        has = DeviceCapabilities.of(joystick)
        self.unknown[instance] = (
            f"{joystick.get_name()} ({has.axes} axes, {has.buttons} buttons) is a gamepad that SDL does not know;"
            " map it with `layflat gamepad calibrate`"
        )

    def _make_device(self, index: int, joystick: Any) -> GamepadDevice | None:
        capabilities = DeviceCapabilities.of(joystick)
        guid = joystick.get_guid()
        settings = self._mapping or mapping_file(guid)
        calibrated, rest = (
            read_settings(settings, capabilities) if self._mapping or settings.is_file() else (None, StickRest())
        )
        if calibrated is not None:
            return RawGamepad(self._pygame, joystick, calibrated, "calibrated", rest)
        if self._controller.is_controller(index):
            controller = self._controller.Controller(index)
            if _fits(controller.get_mapping(), capabilities):
                return ControllerDevice(self._pygame, controller, rest)
        layout = raw_layout(joystick)
        source = f"raw layout {layout.name}" if layout else ""
        return None if layout is None else RawGamepad(self._pygame, joystick, layout, source, rest)

    def close(self) -> None:
        """Release all of them."""
        for device in self.devices.values():
            device.close()
        self.devices.clear()


def _fits(mapping: Mapping[str, str], capabilities: DeviceCapabilities) -> bool:
    """Return whether SDL's mapping names only inputs that the gamepad has: a guessed one may not."""
    limits = {"b": capabilities.buttons, "a": capabilities.axes, "h": capabilities.hats}
    places = [re.fullmatch(r"[+-]?([bah])(\d+)(?:\.\d+)?[~+-]?", str(place)) for place in mapping.values()]
    return all(place is None or int(place[2]) < limits[place[1]] for place in places)


def gamepad_events(pygame: Any) -> list[int]:
    """Return the types of events that gamepads send."""
    names = ("BUTTONDOWN", "BUTTONUP", "AXISMOTION", "DEVICEADDED", "DEVICEREMOVED")
    kinds = [getattr(pygame, kind + name) for kind in ("JOY", "CONTROLLER") for name in names]
    return [*kinds, pygame.JOYHATMOTION, pygame.JOYBALLMOTION, pygame.CONTROLLERDEVICEREMAPPED]
