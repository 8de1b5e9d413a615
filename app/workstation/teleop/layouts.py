"""Layouts of gamepads that SDL's controller database does not know."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

from layflat.app.support.errors import UsageError
from layflat.app.workstation.teleop.gamepad_state import BUTTONS, STICKS, TRIGGERS

PRESSED_FROM = 0.5
"""Deflection from which an axis that stands for a button counts as pressed."""
REQUIRED = ("cross", "circle", "square", "triangle", "share", "options", "l1", "r1")
"""Buttons that a recording with two points needs."""
_FORM = re.compile(r"(?:b(?P<button>\d{1,3})|h(?P<hat>\d)\.(?P<way>[xy][+-])|a(?P<axis>\d{1,2})(?P<sign>[+-]))")


class RawGamepadState(Protocol):
    """Raw inputs, as of pygame.joystick.Joystick."""

    def get_numaxes(self) -> int: ...
    def get_numbuttons(self) -> int: ...
    def get_numhats(self) -> int: ...
    def get_axis(self, axis_number: int, /) -> float: ...
    def get_button(self, button: int, /) -> bool: ...
    def get_hat(self, hat_number: int, /) -> tuple[int, int]: ...


@dataclass(frozen=True)
class Binding:
    """Raw input that stands for a button: ``b3``, ``h0.y+`` (direction of a hat) or ``a5-`` (half an axis)."""

    text: str

    def __post_init__(self) -> None:
        if _FORM.fullmatch(self.text) is None:
            raise UsageError(f"{self.text!r} is not a gamepad button; write b3, h0.y+ or a5-")

    def is_pressed(self, gamepad: RawGamepadState) -> bool:
        """Return whether it is pressed now."""
        parts = _FORM.fullmatch(self.text)
        if parts is None:
            return False
        if parts["button"] is not None:
            return bool(gamepad.get_button(int(parts["button"])))
        if parts["hat"] is not None:
            return gamepad.get_hat(int(parts["hat"]))["xy".index(parts["way"][0])] == _sign(parts["way"][1])
        return gamepad.get_axis(int(parts["axis"])) * _sign(parts["sign"]) > PRESSED_FROM

    def fits(self, capabilities: DeviceCapabilities) -> bool:
        """Return whether such a gamepad has it."""
        parts = _FORM.fullmatch(self.text)
        if parts is None:
            return False
        limits = (("button", capabilities.buttons), ("hat", capabilities.hats), ("axis", capabilities.axes))
        return all(parts[kind] is None or int(parts[kind]) < limit for kind, limit in limits)


@dataclass(frozen=True)
class DeviceCapabilities:
    """Numbers of inputs, by which raw layouts differ."""

    axes: int
    buttons: int
    hats: int

    @classmethod
    def of(cls, gamepad: RawGamepadState) -> DeviceCapabilities:
        """Count the inputs of a gamepad."""
        return cls(gamepad.get_numaxes(), gamepad.get_numbuttons(), gamepad.get_numhats())

    def __str__(self) -> str:
        return f"{self.axes} axes, {self.buttons} buttons and {self.hats} hats"


@dataclass(frozen=True)
class TriggerAxis:
    """Axis that goes from ``rest`` to ``full`` as the trigger is pulled."""

    axis: int
    rest: float = -1.0
    full: float = 1.0

    def value(self, raw: float) -> float:
        """Return how far the trigger is pulled, 0..1."""
        return (raw - self.rest) / (self.full - self.rest)


@dataclass(frozen=True, kw_only=True)
class GamepadLayout:
    """Raw inputs of all sticks, triggers and buttons."""

    name: str
    sticks: Mapping[str, tuple[int, int]]
    """Axis of each of STICKS, and 1 or -1 so that right and down are positive."""
    triggers: Mapping[str, TriggerAxis | Binding] = field(default_factory=dict)
    buttons: Mapping[str, Binding] = field(default_factory=dict)

    def check(self, capabilities: DeviceCapabilities) -> GamepadLayout:
        """Return the layout, or raise UsageError: all sticks, nothing twice, only inputs that the gamepad has."""
        for what, given, known in (
            ("stick axes", self.sticks, STICKS),
            ("triggers", self.triggers, TRIGGERS),
            ("buttons", self.buttons, BUTTONS),
        ):
            unknown = sorted(set(given) - set(known))
            if unknown:
                raise UsageError(f"the mapping has {what} named {', '.join(unknown)}; known are {', '.join(known)}")
        missing = [name for name in STICKS if name not in self.sticks]
        missing += [name for name in REQUIRED if name not in self.buttons]
        if missing:
            raise UsageError(f"the mapping lacks {', '.join(missing)}; calibrate the gamepad again")
        self._check_bindings(capabilities)
        return self

    def _check_bindings(self, capabilities: DeviceCapabilities) -> None:
        axes = {name: axis for name, (axis, _) in self.sticks.items()}
        axes |= {name: trigger.axis for name, trigger in self.triggers.items() if isinstance(trigger, TriggerAxis)}
        bindings = dict(self.buttons) | {n: t for n, t in self.triggers.items() if isinstance(t, Binding)}
        places = [(name, f"axis {axis}", axis < capabilities.axes) for name, axis in axes.items()]
        places += [(name, binding.text, binding.fits(capabilities)) for name, binding in bindings.items()]
        taken: dict[str, str] = {}
        for name, place, exists in places:
            if not exists:
                raise UsageError(f"the mapping has {name} at {place}, which the gamepad lacks; calibrate it again")
            if place in taken:
                raise UsageError(f"the mapping has {taken[place]} and {name} both at {place}; calibrate it again")
            taken[place] = name


def _sign(character: str) -> int:
    return 1 if character == "+" else -1


def _layout(name: str, axes: tuple[str, ...], buttons: tuple[str, ...], dpad: tuple[str, ...] = ()) -> GamepadLayout:
    sticks = {name: (axes.index(name), 1) for name in STICKS}
    triggers = {name: TriggerAxis(axes.index(name)) for name in TRIGGERS}
    bindings = {button: Binding(f"b{index}") for index, button in enumerate(buttons) if button in BUTTONS}
    bindings |= {button: Binding(text) for button, text in zip(BUTTONS[-4:], dpad, strict=False)}
    return GamepadLayout(name=name, sticks=sticks, triggers=triggers, buttons=bindings)


_HAT = ("h0.y+", "h0.y-", "h0.x-", "h0.x+")
_SHOULDERS = ("l1", "r1", "L2 as a button", "R2 as a button")

LAYOUT_A = _layout("A", (*STICKS, "l2", "r2"), BUTTONS)
LAYOUT_B = _layout(
    "B",
    ("left_x", "left_y", "l2", "right_x", "right_y", "r2"),
    ("cross", "circle", "triangle", "square", *_SHOULDERS, "share", "options", "ps", "l3", "r3"),
    _HAT,
)
"""Layout of the Linux kernel's own driver."""
LAYOUT_C = _layout(
    "C",
    ("left_x", "left_y", "right_x", "l2", "r2", "right_y"),
    ("square", "cross", "circle", "triangle", *_SHOULDERS, "share", "options", "l3", "r3", "ps"),
    _HAT,
)
"""Layout under Linux without that driver."""
LAYOUT_C_WITHOUT_HAT = replace(
    LAYOUT_C, buttons={n: binding for n, binding in LAYOUT_C.buttons.items() if n not in BUTTONS[-4:]}
)


def raw_layout(gamepad: RawGamepadState) -> GamepadLayout | None:
    """Return the layout of an unmapped PS4 gamepad, by its numbers of inputs; None for any other gamepad."""
    has = DeviceCapabilities.of(gamepad)
    if has.axes != 6 or has.hats > 1:
        return None
    if (has.buttons, has.hats) == (16, 0):
        return LAYOUT_A
    if has.buttons == 14 or (has.buttons, has.hats) == (13, 0):
        # The generic driver may count the touchpad's click, too, and may have no hat.
        return LAYOUT_C if has.hats else LAYOUT_C_WITHOUT_HAT
    if has.buttons != 13:
        return None
    # The numbers fit B and C. Triggers rest at -1 and sticks at 0, which tells them apart.
    resting = {axis for axis in range(6) if gamepad.get_axis(axis) < -0.99}
    return LAYOUT_C if resting == {3, 4} else LAYOUT_B
