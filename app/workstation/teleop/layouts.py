"""Where a pad has its sticks, triggers and buttons when SDL's controller database does not know it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

from layflat.app.support.errors import UsageError
from layflat.app.workstation.teleop.gamepad_state import BUTTONS, STICKS, TRIGGERS

PRESSED_FROM = 0.5
"""An axis that stands for a button counts as pressed from here."""
REQUIRED = ("cross", "circle", "square", "triangle", "share", "options", "l1", "r1")
"""Buttons that a recording with two pickers cannot do without."""
_FORM = re.compile(r"(?:b(?P<button>\d{1,3})|h(?P<hat>\d)\.(?P<way>[xy][+-])|a(?P<axis>\d{1,2})(?P<sign>[+-]))")


class RawGamepadState(Protocol):
    """As pygame.joystick.Joystick."""

    def get_numaxes(self) -> int: ...
    def get_numbuttons(self) -> int: ...
    def get_numhats(self) -> int: ...
    def get_axis(self, axis_number: int, /) -> float: ...
    def get_button(self, button: int, /) -> bool: ...
    def get_hat(self, hat_number: int, /) -> tuple[int, int]: ...


@dataclass(frozen=True)
class Binding:
    """What on the raw pad stands for a button: ``b3``, ``h0.y+`` (a hat's direction) or ``a5-`` (half an axis)."""

    text: str

    def __post_init__(self) -> None:
        if _FORM.fullmatch(self.text) is None:
            raise UsageError(f"{self.text!r} is no button of a pad; write b3, h0.y+ or a5-")

    def pressed(self, pad: RawGamepadState) -> bool:
        parts = _FORM.fullmatch(self.text)
        if parts is None:
            return False
        if parts["button"] is not None:
            return bool(pad.get_button(int(parts["button"])))
        if parts["hat"] is not None:
            return pad.get_hat(int(parts["hat"]))["xy".index(parts["way"][0])] == _sign(parts["way"][1])
        return pad.get_axis(int(parts["axis"])) * _sign(parts["sign"]) > PRESSED_FROM

    def fits(self, counts: DeviceCapabilities) -> bool:
        """Whether a pad of these counts has it."""
        parts = _FORM.fullmatch(self.text)
        if parts is None:
            return False
        had = (("button", counts.buttons), ("hat", counts.hats), ("axis", counts.axes))
        return all(parts[kind] is None or int(parts[kind]) < count for kind, count in had)


@dataclass(frozen=True)
class DeviceCapabilities:
    """What tells raw layouts apart."""

    axes: int
    buttons: int
    hats: int

    @classmethod
    def of(cls, pad: RawGamepadState) -> DeviceCapabilities:
        return cls(pad.get_numaxes(), pad.get_numbuttons(), pad.get_numhats())


@dataclass(frozen=True)
class TriggerAxis:
    """An axis that goes from ``rest`` to ``full`` as the trigger is pulled."""

    axis: int
    rest: float = -1.0
    full: float = 1.0

    def pulled(self, raw: float) -> float:
        return (raw - self.rest) / (self.full - self.rest)


@dataclass(frozen=True, kw_only=True)
class GamepadLayout:
    """One way in which a raw pad is laid out."""

    name: str
    sticks: Mapping[str, tuple[int, int]]
    """For each of STICKS: the axis, and 1 or -1 so that right and down are positive."""
    triggers: Mapping[str, TriggerAxis | Binding] = field(default_factory=dict)
    buttons: Mapping[str, Binding] = field(default_factory=dict)

    def check(self, counts: DeviceCapabilities) -> GamepadLayout:
        """Itself, or UsageError: all sticks there, nothing twice, nothing that the pad has not got."""
        for what, there, known in (
            ("stick axes", self.sticks, STICKS),
            ("triggers", self.triggers, TRIGGERS),
            ("buttons", self.buttons, BUTTONS),
        ):
            unknown = sorted(set(there) - set(known))
            if unknown:
                raise UsageError(f"the mapping has {what} called {', '.join(unknown)}; known are {', '.join(known)}")
        missing = [name for name in STICKS if name not in self.sticks]
        missing += [name for name in REQUIRED if name not in self.buttons]
        if missing:
            raise UsageError(f"the mapping lacks {', '.join(missing)}; calibrate the pad again")
        self._check_apart(counts)
        return self

    def _check_apart(self, counts: DeviceCapabilities) -> None:
        axes = {name: axis for name, (axis, _) in self.sticks.items()}
        axes |= {name: way.axis for name, way in self.triggers.items() if isinstance(way, TriggerAxis)}
        bindings = dict(self.buttons) | {n: way for n, way in self.triggers.items() if isinstance(way, Binding)}
        places = [(name, f"axis {axis}", axis < counts.axes) for name, axis in axes.items()]
        places += [(name, way.text, way.fits(counts)) for name, way in bindings.items()]
        seen: dict[str, str] = {}
        for name, place, there in places:
            if not there:
                raise UsageError(f"the mapping has {name} at {place}, which the pad has not got; calibrate it again")
            if place in seen:
                raise UsageError(f"the mapping has {seen[place]} and {name} both at {place}; calibrate the pad again")
            seen[place] = name


def _sign(character: str) -> int:
    return 1 if character == "+" else -1


def _axes(*names: str) -> tuple[dict[str, tuple[int, int]], dict[str, TriggerAxis | Binding]]:
    where = {name: index for index, name in enumerate(names)}
    return {name: (where[name], 1) for name in STICKS}, {name: TriggerAxis(where[name]) for name in TRIGGERS}


def _layout(name: str, axes: tuple[str, ...], buttons: tuple[str, ...], dpad: tuple[str, ...] = ()) -> GamepadLayout:
    sticks, triggers = _axes(*axes)
    bindings = {button: Binding(f"b{index}") for index, button in enumerate(buttons) if button in BUTTONS}
    bindings |= {way: Binding(text) for way, text in zip(BUTTONS[-4:], dpad, strict=False)}
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
"""The Linux kernel's own driver."""
LAYOUT_C = _layout(
    "C",
    ("left_x", "left_y", "right_x", "l2", "r2", "right_y"),
    ("square", "cross", "circle", "triangle", *_SHOULDERS, "share", "options", "l3", "r3", "ps"),
    _HAT,
)
"""Linux without that driver."""
LAYOUT_C_WITHOUT_HAT = replace(
    LAYOUT_C, buttons={n: way for n, way in LAYOUT_C.buttons.items() if n not in BUTTONS[-4:]}
)
LAYOUTS = (LAYOUT_A, LAYOUT_B, LAYOUT_C)


def raw_layout(pad: RawGamepadState) -> GamepadLayout | None:
    """The layout of an unmapped PS4 pad, by its counts; None for any other pad."""
    counts = DeviceCapabilities.of(pad)
    if counts.axes != 6 or counts.hats > 1:
        return None
    if (counts.buttons, counts.hats) == (16, 0):
        return LAYOUT_A
    if counts.buttons == 14 or (counts.buttons, counts.hats) == (13, 0):
        # The generic driver may count the touchpad's click, too, and may have no hat.
        return LAYOUT_C if counts.hats else LAYOUT_C_WITHOUT_HAT
    if counts.buttons != 13:
        return None
    # By the counts both B and C. Triggers rest at -1, sticks at 0: where three axes in the middle tell, they are asked.
    resting = {axis for axis in range(6) if pad.get_axis(axis) < -0.99}
    return LAYOUT_C if resting == {3, 4} else LAYOUT_B
