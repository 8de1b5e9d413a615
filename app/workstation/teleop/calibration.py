"""Calibration: finds a gamepad's sticks, triggers and buttons step by step, without SDL and a wall clock."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

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
from layflat.app.workstation.teleop.mapping import (
    REQUIRED,
    DeviceCapabilities,
    PadMapping,
    RawGamepadState,
    check_mapping,
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


@dataclass(frozen=True)
class RawState:
    """One moment of an unmapped gamepad."""

    axes: tuple[float, ...]
    pressed: frozenset[str]
    """Buttons and hat directions, as mappings write them."""

    @classmethod
    def of(cls, gamepad: RawGamepadState) -> RawState:
        """Read all inputs."""
        has = DeviceCapabilities.of(gamepad)
        pressed = {f"b{k}" for k in range(has.buttons) if gamepad.get_button(k)}
        for k in range(has.hats):
            x, y = gamepad.get_hat(k)
            pressed |= {f"h{k}.{bit}" for bit, on in ((1, y > 0), (2, x > 0), (4, y < 0), (8, x < 0)) if on}
        return cls(tuple(gamepad.get_axis(k) for k in range(has.axes)), frozenset(pressed))


class Calibration:
    """Dialogue with a person: call `update` again and again until `done`, then `mapping`.

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
        self._capabilities, self._prompt, self._clock = capabilities, prompt, clock
        self._found: dict[str, str] = {}
        self._known_axes: set[int] = set()
        """Axes that stand for something."""
        self._known: set[str] = set()
        """Buttons and hat directions that stand for something."""
        self._raw = RawState((), frozenset())
        self._rest: tuple[float, ...] = ()
        self._rests: list[tuple[float, ...]] = []
        """Axes after each stick was let go."""
        self.done = False
        self._steps = self._all_steps(STICKS if only_sticks else (*TRIGGERS, *STICKS, *BUTTONS))

    def update(self, raw: RawState) -> None:
        """Take a reading; LayflatError where nothing was pressed for too long."""
        self._raw = raw
        if not self.done:
            self.done = next(self._steps, "done") == "done"

    def mapping(self) -> PadMapping:
        """Return the checked mapping."""
        return check_mapping(self._found, self._capabilities)

    def rest(self) -> StickRest:
        """Return where the sticks rest."""
        middle, away = {}, {}
        for name in STICKS:
            place = self._found[name]
            sign = -1 if place.endswith("~") else 1
            readings = [sign * axes[int(place[1:].rstrip("~"))] for axes in self._rests]
            middle[name] = min(max((min(readings) + max(readings)) / 2.0, -MIDDLE_MAX), MIDDLE_MAX)
            away[name] = max(abs(reading - middle[name]) for reading in readings)
        farthest = max(math.hypot(away[f"{side}_x"], away[f"{side}_y"]) for side in ("left", "right"))
        dead = min(max(DEAD_FACTOR * farthest + DEAD_MARGIN, DEAD_LEAST), DEAD_ZONE_MAX)
        return StickRest(dead_zone=round(dead, 3), middle={name: round(value, 3) for name, value in middle.items()})

    def _all_steps(self, names: Iterable[str]) -> Iterator[None]:
        """Yield whenever a new reading is needed."""
        self._prompt("lay the gamepad down and touch nothing")
        yield from self._wait_until_still()
        self._rest = self._raw.axes
        for name in names:
            yield from self._find(name)

    def _find(self, name: str) -> Iterator[None]:
        """Ask for an input and wait for it; one that a gamepad may lack is left out after a while."""
        required, is_trigger = name in REQUIRED, name in TRIGGERS
        ask = f"pull {label(name)} all the way and hold it" if is_trigger else f"press {label(name)}"
        ask = _PROMPTS.get(name, ask).replace("press d-pad", "press the d-pad")
        self._prompt(ask + ("" if required else " (or wait, if there is none)"))
        began, before = self._clock(), self._raw.axes if is_trigger else self._rest
        while required or self._clock() - began <= OPTIONAL_S:
            yield
            axis = self._moved_axis(STIRRED if is_trigger else MOVED, before) if name not in BUTTONS[:-4] else None
            press = None if name in STICKS else self._new_press()
            if axis is not None and name in BUTTONS:  # Half an axis as a button of the d-pad.
                half = f"{'+' if self._raw.axes[axis] > self._rest[axis] else '-'}a{axis}"
                press = press or (None if half in self._known else half)
            elif axis is not None:
                yield from (self._measure_trigger if is_trigger else self._measure_stick)(name, axis)
                return
            if press is not None and (not is_trigger or self._clock() - began > STILL_S):
                yield from self._accept(name, press)
                return
            if required and self._clock() - began > REQUIRED_S:
                what = name.replace("_", " ")
                raise LayflatError(f"nothing was pressed for {what} in {REQUIRED_S:.0f} s; nothing was written")
        self._prompt(f"{label(name)} is left out")

    def _wait_until_still(self) -> Iterator[None]:
        since, axes = self._clock(), self._raw.axes
        while self._clock() - since < STILL_S or not axes:
            yield
            now = self._raw
            if now.pressed or not axes or max(abs(a - b) for a, b in zip(axes, now.axes, strict=True)) > SETTLED:
                since, axes = self._clock(), now.axes

    def _measure_trigger(self, name: str, axis: int) -> Iterator[None]:
        """Find out where a trigger rests, after it was held, as it is now."""
        full, since = self._raw.axes[axis], self._clock()
        while self._clock() - since < STILL_S:
            yield
            self._known |= self._raw.pressed  # Many gamepads have a trigger as a button, too.
            if abs(self._raw.axes[axis] - full) > SETTLED:
                full, since = self._raw.axes[axis], self._clock()
        self._prompt("release it")
        while abs(self._raw.axes[axis] - full) < MOVED:
            yield
        yield from self._note_rest(axis)
        rest = self._rest[axis]
        whole = abs(rest) > 0.5
        half = "" if whole else "+" if full > rest else "-"
        self._found[name] = f"{half}a{axis}" + ("~" if whole and full < rest else "")

    def _measure_stick(self, name: str, axis: int) -> Iterator[None]:
        """Wait until a stick is let go."""
        sign = 1 if self._raw.axes[axis] > self._rest[axis] else -1
        self._found[name] = f"a{axis}" + ("~" if sign < 0 else "")
        farthest = -math.inf
        while farthest - sign * self._raw.axes[axis] < CAME_BACK:
            farthest = max(farthest, sign * self._raw.axes[axis])
            yield
        yield from self._note_rest(axis)
        self._rests.append(self._raw.axes)

    def _note_rest(self, axis: int) -> Iterator[None]:
        self._known_axes.add(axis)
        yield from self._wait_until_still()
        self._rest = (*self._rest[:axis], self._raw.axes[axis], *self._rest[axis + 1 :])

    def _accept(self, name: str, place: str) -> Iterator[None]:
        """Note an input, and wait until everything is released."""
        self._found[name] = place
        self._known.add(place)
        while self._raw.pressed or self._moved_axis(STIRRED, self._rest, known=True) is not None:
            yield

    def _moved_axis(self, by: float, rest: tuple[float, ...], *, known: bool = False) -> int | None:
        """Return the axis farthest from its rest, by at least so much; ``known``: among all, not only unknown ones."""
        distance = {k: abs(a - b) for k, (a, b) in enumerate(zip(self._raw.axes, rest, strict=True))}
        moved = [k for k in distance if distance[k] > by and (known or k not in self._known_axes)]
        return max(moved, key=distance.__getitem__, default=None)

    def _new_press(self) -> str | None:
        """Return a pressed button that stands for nothing yet."""
        return min(self._raw.pressed - self._known, default=None)
