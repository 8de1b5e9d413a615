"""Calibration: finds a gamepad's sticks, triggers and buttons step by step, without SDL and a wall clock."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from layflat.app.support.errors import LayflatError
from layflat.app.workstation.teleop.gamepad_state import (
    BUTTONS,
    DEAD_ZONE_MAX,
    MIDDLE_MAX,
    STICKS,
    TRIGGERS,
    StickRest,
    label,
)
from layflat.app.workstation.teleop.layouts import (
    REQUIRED,
    Binding,
    DeviceCapabilities,
    GamepadLayout,
    RawGamepadState,
    TriggerAxis,
)

MOVED = 0.6
"""Distance from its rest at which an axis has been moved on purpose."""
STIRRED = 0.3
SETTLED = 0.05
"""Change of an axis that is held still."""
CAME_BACK = 0.4
"""Way back of a stick from its farthest place that means that it was let go."""
DEAD_LEAST, DEAD_FACTOR, DEAD_MARGIN = 0.06, 1.5, 0.04
"""Dead zone: so many times as far as the stick was seen to rest from its middle, and a margin for what was not seen."""
STILL_S = 0.3
OPTIONAL_S = 6.0
REQUIRED_S = 60.0
_PROMPTS = {
    "left_x": "push the left stick to the right",
    "left_y": "pull the left stick down, towards you",
    "right_x": "push the right stick to the right",
    "right_y": "pull the right stick down, towards you",
    "cross": "press Cross (the lowest of the four, A on other gamepads)",
    "circle": "press Circle (the right one of the four, B on other gamepads)",
    "square": "press Square (the left one of the four, X on other gamepads)",
    "triangle": "press Triangle (the upper one of the four, Y on other gamepads)",
    "share": "press Share (left of the middle; Back or View on other gamepads)",
    "options": "press Options (right of the middle; Start or Menu on other gamepads)",
    "ps": "press PS (the maker's button)",
    "l3": "press the left stick down like a button",
    "r3": "press the right stick down like a button",
}
_DPAD = BUTTONS[-4:]


@dataclass(frozen=True)
class RawState:
    """One moment of an unmapped gamepad."""

    axes: tuple[float, ...]
    pressed: frozenset[str]
    """Buttons and hat directions, as Binding writes them."""

    @classmethod
    def of(cls, gamepad: RawGamepadState) -> RawState:
        """Read all inputs."""
        has = DeviceCapabilities.of(gamepad)
        texts = [f"b{k}" for k in range(has.buttons)]
        texts += [f"h{k}.{axis}{sign}" for k in range(has.hats) for axis in "xy" for sign in "+-"]
        axes = tuple(gamepad.get_axis(k) for k in range(has.axes))
        return cls(axes, frozenset(text for text in texts if Binding(text).is_pressed(gamepad)))


@dataclass
class _Found:
    """Inputs found so far."""

    sticks: dict[str, tuple[int, int]] = field(default_factory=dict)
    triggers: dict[str, TriggerAxis | Binding] = field(default_factory=dict)
    buttons: dict[str, Binding] = field(default_factory=dict)
    axes: set[int] = field(default_factory=set)
    """Axes that stand for something."""
    texts: set[str] = field(default_factory=set)
    """Buttons and hat directions that stand for something."""


class Calibration:
    """Dialogue with a person: call `update` again and again until `done`, then `layout`.

    Triggers come first: until they are moved they may read 0, and where they rest is only known once they have been
    released. Buttons that a gamepad may lack are left out when nothing is pressed for a few seconds.
    """

    def __init__(
        self,
        capabilities: DeviceCapabilities,
        prompt: Callable[[str], None],
        clock: Callable[[], float],
        *,
        only_sticks: bool = False,
    ) -> None:
        """Start a calibration that asks the person by ``prompt``; ``only_sticks``: it learns only where they rest."""
        if capabilities.axes < len(STICKS):
            raise LayflatError(
                f"the gamepad has {capabilities.axes} axes, and two sticks need four; use another one, or the keyboard"
            )
        self._capabilities = capabilities
        self._prompt = prompt
        self._clock = clock
        self._found = _Found()
        self._raw = RawState((), frozenset())
        self._rest: tuple[float, ...] = ()
        self._rests: list[tuple[float, ...]] = []
        """Axes after each stick was let go."""
        self._only_sticks = only_sticks
        self.done = False
        self._steps = self._all_steps()

    def update(self, gamepad: RawGamepadState) -> None:
        """Read the gamepad; LayflatError where nothing was pressed for too long."""
        self._raw = RawState.of(gamepad)
        if not self.done:
            self.done = next(self._steps, "done") == "done"

    def layout(self) -> GamepadLayout:
        """Return the checked layout."""
        found = self._found
        layout = GamepadLayout(name="calibrated", sticks=found.sticks, triggers=found.triggers, buttons=found.buttons)
        return layout.check(self._capabilities)

    def rest(self) -> StickRest:
        """Return where the sticks rest."""
        middle, away = {}, {}
        for name, (axis, sign) in self._found.sticks.items():
            readings = [sign * axes[axis] for axes in self._rests]
            middle[name] = min(max((min(readings) + max(readings)) / 2.0, -MIDDLE_MAX), MIDDLE_MAX)
            away[name] = max(abs(reading - middle[name]) for reading in readings)
        farthest = max(math.hypot(away[f"{side}_x"], away[f"{side}_y"]) for side in ("left", "right"))
        dead = min(max(DEAD_FACTOR * farthest + DEAD_MARGIN, DEAD_LEAST), DEAD_ZONE_MAX)
        return StickRest(dead_zone=round(dead, 3), middle={name: round(value, 3) for name, value in middle.items()})

    def _all_steps(self) -> Iterator[None]:
        """Yield whenever a new reading is needed."""
        self._prompt("lay the gamepad down and touch nothing")
        yield from self._wait_until_still()
        self._rest = self._raw.axes
        for name in () if self._only_sticks else TRIGGERS:
            yield from self._find_trigger(name)
        for name in STICKS:
            yield from self._find_stick(name)
        for name in () if self._only_sticks else BUTTONS:
            yield from self._find_button(name)

    def _wait_until_still(self) -> Iterator[None]:
        since, axes = self._clock(), self._raw.axes
        while self._clock() - since < STILL_S or not axes:
            yield
            now = self._raw
            if now.pressed or not axes or max(abs(a - b) for a, b in zip(axes, now.axes, strict=True)) > SETTLED:
                since, axes = self._clock(), now.axes

    def _find_trigger(self, name: str) -> Iterator[None]:
        self._prompt(f"pull {label(name)} all the way and hold it (or wait, if there is none)")
        began, before = self._clock(), self._raw.axes
        while True:
            yield
            if self._clock() - began > OPTIONAL_S:
                self._prompt(f"{label(name)} is left out")
                return
            axis = self._moved_axis(STIRRED, before)
            pressed = self._new_press()
            if axis is not None:
                yield from self._measure_trigger(name, axis)
                return
            if pressed is not None and self._clock() - began > STILL_S:
                self._found.triggers[name] = Binding(pressed)
                yield from self._accept(pressed)
                return

    def _measure_trigger(self, name: str, axis: int) -> Iterator[None]:
        pressed: set[str] = set()
        full, since = self._raw.axes[axis], self._clock()
        while self._clock() - since < STILL_S:
            yield
            pressed |= self._raw.pressed
            if abs(self._raw.axes[axis] - full) > SETTLED:
                full, since = self._raw.axes[axis], self._clock()
        self._prompt("release it")
        while abs(self._raw.axes[axis] - full) < MOVED:
            yield
        yield from self._wait_until_still()
        rest = self._raw.axes[axis]
        self._rest = (*self._rest[:axis], rest, *self._rest[axis + 1 :])
        self._found.triggers[name] = TriggerAxis(axis, round(rest, 3), round(full, 3))
        self._found.axes.add(axis)
        self._found.texts |= pressed  # Many gamepads have a trigger as a button, too.

    def _find_stick(self, name: str) -> Iterator[None]:
        self._prompt(_PROMPTS[name])
        began = self._clock()
        axis = None
        while axis is None:
            yield
            self._check_patience(began, name)
            axis = self._moved_axis(MOVED, self._rest)
        sign = 1 if self._raw.axes[axis] > self._rest[axis] else -1
        self._found.sticks[name] = (axis, sign)
        self._found.axes.add(axis)
        farthest = -math.inf
        while farthest - sign * self._raw.axes[axis] < CAME_BACK:
            farthest = max(farthest, sign * self._raw.axes[axis])
            yield
        yield from self._wait_until_still()
        self._rest = (*self._rest[:axis], self._raw.axes[axis], *self._rest[axis + 1 :])
        self._rests.append(self._raw.axes)

    def _find_button(self, name: str) -> Iterator[None]:
        required = name in REQUIRED
        what = f"press the d-pad {name}" if name in _DPAD else f"press {label(name)}"
        self._prompt(_PROMPTS.get(name, what) + ("" if required else " (or wait, if there is none)"))
        began = self._clock()
        while True:
            yield
            text = self._new_press()
            axis = self._moved_axis(MOVED, self._rest) if text is None and name in _DPAD else None
            if axis is not None:
                text = f"a{axis}{'+' if self._raw.axes[axis] > self._rest[axis] else '-'}"
                text = None if text in self._found.texts else text
            if text is not None:
                self._found.buttons[name] = Binding(text)
                yield from self._accept(text)
                return
            if required:
                self._check_patience(began, name)
            elif self._clock() - began > OPTIONAL_S:
                self._prompt(f"{label(name)} is left out")
                return

    def _accept(self, text: str) -> Iterator[None]:
        self._found.texts.add(text)
        yield from self._wait_until_released()

    def _wait_until_released(self) -> Iterator[None]:
        while self._raw.pressed or self._moved_axis(STIRRED, self._rest, known=True) is not None:
            yield

    def _moved_axis(self, by: float, rest: tuple[float, ...], *, known: bool = False) -> int | None:
        """Return the axis farthest from its rest, by at least so much; ``known``: among all, not only unknown ones."""
        distance = {k: abs(a - b) for k, (a, b) in enumerate(zip(self._raw.axes, rest, strict=True))}
        moved = [k for k in distance if distance[k] > by and (known or k not in self._found.axes)]
        return max(moved, key=distance.__getitem__, default=None)

    def _new_press(self) -> str | None:
        """Return a pressed button that stands for nothing yet."""
        return min(self._raw.pressed - self._found.texts, default=None)

    def _check_patience(self, began: float, name: str) -> None:
        if self._clock() - began > REQUIRED_S:
            what = name.replace("_", " ")
            raise LayflatError(f"nothing was pressed for {what} in {REQUIRED_S:.0f} s; nothing was written")
