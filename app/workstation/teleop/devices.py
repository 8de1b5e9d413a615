"""GamepadRegistry that are plugged in: SDL's controllers first, then what was calibrated, then the known raw
layouts."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

from layflat.app.support.errors import LayflatError
from layflat.app.workstation.teleop.gamepad_state import BUTTONS, STICKS, TRIGGERS, GamepadState, state_of
from layflat.app.workstation.teleop.layouts import Binding, DeviceCapabilities, GamepadLayout, raw_layout
from layflat.app.workstation.teleop.mapping import read_mapping, saved_mapping

FULL = 32767
"""Of an axis of SDL's controllers."""
UNMOVED = (16383, 16384)
"""What a controller's trigger reads where the raw axis has not moved yet and reads 0."""


class Device(Protocol):
    """One pad."""

    name: str
    how: str
    """How its buttons are known: "SDL", "calibrated", "raw layout B"."""
    instance: int
    """SDL's number for it while it is plugged in."""

    def state(self) -> GamepadState: ...

    def press(self, event: Any) -> str | None:
        """The button whose press this event of the pad is, if it is one."""

    def rumble(self, strength: float, seconds: float) -> bool:
        """False where the pad cannot."""

    def close(self) -> None: ...


class _FirstMoves:
    """Until it is first moved a trigger may read 0, which would be half pulled: till then it counts as let go."""

    def __init__(self) -> None:
        self._moved: set[str] = set()

    def pulled(self, name: str, value: float, *, unmoved: bool) -> float:
        if name not in self._moved:
            if unmoved:
                return 0.0
            self._moved.add(name)
        return value


class ControllerDevice:
    """A pad that SDL's database knows."""

    how = "SDL"

    def __init__(self, pygame: Any, controller: Any) -> None:
        self._pygame = pygame
        self._controller = controller
        self._joystick = controller.as_joystick()
        self.name = str(controller.name)
        self.instance = int(self._joystick.get_instance_id())
        self._triggers = _FirstMoves()

    def state(self) -> GamepadState:
        raw = [self._controller.get_axis(axis) for axis in range(len(STICKS) + len(TRIGGERS))]
        sticks = {name: max(raw[axis] / FULL, -1.0) for axis, name in enumerate(STICKS)}
        triggers = {
            name: self._triggers.pulled(name, value / FULL, unmoved=value in UNMOVED or value == 0)
            for name, value in zip(TRIGGERS, raw[len(STICKS) :], strict=True)
        }
        return state_of(sticks, triggers, [n for k, n in enumerate(BUTTONS) if self._controller.get_button(k)])

    def press(self, event: Any) -> str | None:
        if event.type == self._pygame.CONTROLLERBUTTONDOWN and event.button < len(BUTTONS):
            return BUTTONS[event.button]
        return None

    def rumble(self, strength: float, seconds: float) -> bool:
        return bool(self._controller.rumble(strength, strength, int(1000 * seconds)))

    def close(self) -> None:
        with contextlib.suppress(self._pygame.error):
            self._controller.quit()


class RawGamepad:
    """A pad whose buttons a layout knows."""

    def __init__(self, pygame: Any, joystick: Any, layout: GamepadLayout, how: str) -> None:
        self._pygame = pygame
        self._joystick = joystick
        self._layout = layout
        self.how = how
        self.name = str(joystick.get_name())
        self.instance = int(joystick.get_instance_id())
        self._triggers = _FirstMoves()

    def state(self) -> GamepadState:
        sticks = {name: sign * self._joystick.get_axis(axis) for name, (axis, sign) in self._layout.sticks.items()}
        triggers = {name: self._trigger(name) for name in self._layout.triggers}
        return state_of(sticks, triggers, [n for n, way in self._layout.buttons.items() if way.pressed(self._joystick)])

    def _trigger(self, name: str) -> float:
        way = self._layout.triggers[name]
        if isinstance(way, Binding):
            return float(way.pressed(self._joystick))
        raw = self._joystick.get_axis(way.axis)
        return self._triggers.pulled(name, way.pulled(raw), unmoved=raw == 0 and way.rest != 0)

    def press(self, event: Any) -> str | None:
        if event.type == self._pygame.JOYBUTTONDOWN:
            return self._named(f"b{event.button}")
        if event.type == self._pygame.JOYHATMOTION:
            x, y = event.value
            ways = [f"h{event.hat}.{axis}{'+' if value > 0 else '-'}" for axis, value in (("x", x), ("y", y)) if value]
            return next(filter(None, map(self._named, ways)), None)
        return None

    def _named(self, text: str) -> str | None:
        return next((name for name, way in self._layout.buttons.items() if way.text == text), None)

    def rumble(self, strength: float, seconds: float) -> bool:
        return bool(self._joystick.rumble(strength, strength, int(1000 * seconds)))

    def close(self) -> None:
        with contextlib.suppress(self._pygame.error):
            self._joystick.quit()


class GamepadRegistry:
    """All pads that are plugged in, by SDL's instance numbers; ``refresh`` notices plugging and unplugging."""

    def __init__(self, pygame: Any, controller: Any, *, mapping: Path | None = None) -> None:
        """``mapping``: a file to use for every pad that it fits, instead of the user's own."""
        self._pygame = pygame
        self._controller = controller
        self._mapping = mapping
        self.devices: dict[int, Device] = {}
        """Usable ones, in the order in which they came."""
        self._open: dict[int, tuple[int, Any]] = {}
        self.unknown: dict[int, str] = {}
        """GamepadRegistry whose buttons nobody knows, and why: one sentence each."""

    def refresh(self) -> None:
        joysticks = self._joysticks()
        self._open = joysticks  # Or those that nobody reads would be closed, and opened again each time.
        for instance in [i for i in self.devices if i not in joysticks]:
            self.devices.pop(instance).close()
        for instance in [i for i in self.unknown if i not in joysticks]:
            del self.unknown[instance]
        for instance, (index, joystick) in joysticks.items():
            if instance not in self.devices and instance not in self.unknown:
                self._add(instance, index, joystick)

    def _joysticks(self) -> dict[int, tuple[int, Any]]:
        """Index and joystick by instance number."""
        found = {}
        for index in range(self._pygame.joystick.get_count()):
            with contextlib.suppress(self._pygame.error):  # It may go between counting and opening.
                joystick = self._pygame.joystick.Joystick(index)
                found[int(joystick.get_instance_id())] = (index, joystick)
        return found

    def _add(self, instance: int, index: int, joystick: Any) -> None:
        try:
            device = self._device(index, joystick)
        except (LayflatError, self._pygame.error) as error:
            self.unknown[instance] = str(error)
            return
        if device is None:
            counts = DeviceCapabilities.of(joystick)
            self.unknown[instance] = (
                f"{joystick.get_name()} ({counts.axes} axes, {counts.buttons} buttons) is a pad that SDL does not know;"
                " `layflat gamepad calibrate` maps it"
            )
        else:
            self.devices[instance] = device

    def _device(self, index: int, joystick: Any) -> Device | None:
        counts = DeviceCapabilities.of(joystick)
        guid = joystick.get_guid()
        calibrated = read_mapping(self._mapping, counts) if self._mapping else saved_mapping(guid, counts)
        if calibrated is not None:
            return RawGamepad(self._pygame, joystick, calibrated, "calibrated")
        if self._controller.is_controller(index):
            controller = self._controller.Controller(index)
            if _fits(controller.get_mapping(), counts):
                return ControllerDevice(self._pygame, controller)
        layout = raw_layout(joystick)
        return None if layout is None else RawGamepad(self._pygame, joystick, layout, f"raw layout {layout.name}")

    def close(self) -> None:
        for device in self.devices.values():
            device.close()
        self.devices.clear()


def _fits(mapping: Mapping[str, str], counts: DeviceCapabilities) -> bool:
    """Whether SDL's mapping names only what the pad has: one that was guessed may not."""
    limits = {"b": counts.buttons, "a": counts.axes, "h": counts.hats}
    places = [re.fullmatch(r"[+-]?([bah])(\d+)(?:\.\d+)?[~+-]?", str(place)) for place in mapping.values()]
    return all(place is None or int(place[2]) < limits[place[1]] for place in places)


def pad_events(pygame: Any) -> list[int]:
    """Types of the events that pads send."""
    names = ("BUTTONDOWN", "BUTTONUP", "AXISMOTION", "DEVICEADDED", "DEVICEREMOVED")
    kinds = [getattr(pygame, kind + name) for kind in ("JOY", "CONTROLLER") for name in names]
    return [*kinds, pygame.JOYHATMOTION, pygame.JOYBALLMOTION, pygame.CONTROLLERDEVICEREMAPPED]
