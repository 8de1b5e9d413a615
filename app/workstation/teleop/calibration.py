"""Finds out step by step where a pad has its sticks, triggers and buttons; knows neither SDL nor the wall's clock."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from layflat.app.support.errors import LayflatError
from layflat.app.workstation.teleop.gamepad_state import BUTTONS, STICKS, TRIGGERS, label
from layflat.app.workstation.teleop.layouts import (
    REQUIRED,
    Binding,
    DeviceCapabilities,
    GamepadLayout,
    RawGamepadState,
    TriggerAxis,
)

MOVED = 0.6
"""An axis this far from where it rests has been moved on purpose."""
STIRRED = 0.3
SETTLED = 0.05
"""An axis that changes by less is held still."""
STILL_S = 0.3
OPTIONAL_S = 6.0
REQUIRED_S = 60.0
_PROMPTS = {
    "left_x": "push the left stick to the right",
    "left_y": "pull the left stick down, towards you",
    "right_x": "push the right stick to the right",
    "right_y": "pull the right stick down, towards you",
    "cross": "press Cross (the lowest of the four, A on other pads)",
    "circle": "press Circle (the right one of the four, B on other pads)",
    "square": "press Square (the left one of the four, X on other pads)",
    "triangle": "press Triangle (the upper one of the four, Y on other pads)",
    "share": "press Share (left of the middle; Back or View on other pads)",
    "options": "press Options (right of the middle; Start or Menu on other pads)",
    "ps": "press PS (the maker's button)",
    "l3": "press the left stick down like a button",
    "r3": "press the right stick down like a button",
}
_DPAD = BUTTONS[-4:]


@dataclass(frozen=True)
class RawState:
    """One moment of an unmapped pad."""

    axes: tuple[float, ...]
    pressed: frozenset[str]
    """Buttons and hat directions, as Binding writes them."""

    @classmethod
    def of(cls, pad: RawGamepadState) -> RawState:
        counts = DeviceCapabilities.of(pad)
        texts = [f"b{k}" for k in range(counts.buttons)]
        texts += [f"h{k}.{axis}{sign}" for k in range(counts.hats) for axis in "xy" for sign in "+-"]
        axes = tuple(pad.get_axis(k) for k in range(counts.axes))
        return cls(axes, frozenset(text for text in texts if Binding(text).pressed(pad)))


@dataclass
class _Found:
    """What the steps have found so far."""

    sticks: dict[str, tuple[int, int]] = field(default_factory=dict)
    triggers: dict[str, TriggerAxis | Binding] = field(default_factory=dict)
    buttons: dict[str, Binding] = field(default_factory=dict)
    axes: set[int] = field(default_factory=set)
    """That stand for something."""
    texts: set[str] = field(default_factory=set)


class Calibration:
    """``see`` it all, again and again, until ``done``; then ``layout``.

    Triggers come first: until they are moved they may read 0, and where they rest is only known when they have been let
    go of. Buttons that a pad may lack are left out when nothing comes for a few seconds.
    """

    def __init__(self, counts: DeviceCapabilities, ask: Callable[[str], None], clock: Callable[[], float]) -> None:
        """``ask`` is told each time what the person is to do."""
        if counts.axes < len(STICKS):
            raise LayflatError(
                f"the pad has {counts.axes} axes, and two sticks need four; use another pad, or the keyboard"
            )
        self._counts = counts
        self._ask = ask
        self._clock = clock
        self._found = _Found()
        self._raw = RawState((), frozenset())
        self._rest: list[float] = []
        self.done = False
        self._steps = self._all_steps()

    def see(self, pad: RawGamepadState) -> None:
        """Look at the pad. LayflatError where nothing has come for too long."""
        self._raw = RawState.of(pad)
        if not self.done:
            self.done = next(self._steps, "done") == "done"

    def layout(self) -> GamepadLayout:
        """What was found, checked."""
        found = self._found
        layout = GamepadLayout(name="calibrated", sticks=found.sticks, triggers=found.triggers, buttons=found.buttons)
        return layout.check(self._counts)

    def _all_steps(self) -> Iterator[None]:
        """Yields where it has to look again."""
        self._ask("lay the pad down and touch nothing")
        yield from self._still()
        self._rest = list(self._raw.axes)
        for name in TRIGGERS:
            yield from self._trigger(name)
        for name in STICKS:
            yield from self._stick(name)
        for name in BUTTONS:
            yield from self._button(name)

    def _still(self) -> Iterator[None]:
        """Until nothing is pressed and no axis moves."""
        since, axes = self._clock(), self._raw.axes
        while self._clock() - since < STILL_S or not axes:
            yield
            if (
                self._raw.pressed
                or not axes
                or max(abs(a - b) for a, b in zip(axes, self._raw.axes, strict=True)) > SETTLED
            ):
                since, axes = self._clock(), self._raw.axes

    def _trigger(self, name: str) -> Iterator[None]:
        self._ask(f"pull {label(name)} all the way and hold it (or wait, if there is none)")
        began, before = self._clock(), self._raw.axes
        while True:
            yield
            if self._clock() - began > OPTIONAL_S:
                self._ask(f"{label(name)} is left out")
                return
            moved = self._moved(STIRRED, before)
            fresh = self._fresh()
            if moved is not None:
                yield from self._trigger_axis(name, moved)
                return
            if fresh is not None and self._clock() - began > STILL_S:
                self._found.triggers[name] = Binding(fresh)
                yield from self._take(fresh)
                return

    def _trigger_axis(self, name: str, axis: int) -> Iterator[None]:
        also: set[str] = set()
        full, since = self._raw.axes[axis], self._clock()
        while self._clock() - since < STILL_S:
            yield
            also |= self._raw.pressed
            if abs(self._raw.axes[axis] - full) > SETTLED:
                full, since = self._raw.axes[axis], self._clock()
        self._ask("let go")
        while abs(self._raw.axes[axis] - full) < MOVED:
            yield
        yield from self._still()
        rest = self._raw.axes[axis]
        self._rest[axis] = rest
        self._found.triggers[name] = TriggerAxis(axis, round(rest, 3), round(full, 3))
        self._found.axes.add(axis)
        self._found.texts |= also  # Many pads have a trigger as a button, too.

    def _stick(self, name: str) -> Iterator[None]:
        self._ask(_PROMPTS[name])
        began = self._clock()
        axis = None
        while axis is None:
            yield
            self._check_patience(began, name)
            axis = self._moved(MOVED, tuple(self._rest))
        self._found.sticks[name] = (axis, 1 if self._raw.axes[axis] > self._rest[axis] else -1)
        self._found.axes.add(axis)
        yield from self._let_go()

    def _button(self, name: str) -> Iterator[None]:
        needed = name in REQUIRED
        what = f"press {label(name)}" if name not in _DPAD else f"press the d-pad {name}"
        self._ask(_PROMPTS.get(name, what) + ("" if needed else " (or wait, if there is none)"))
        began = self._clock()
        while True:
            yield
            text = self._fresh()
            axis = self._moved(MOVED, tuple(self._rest)) if text is None and name in _DPAD else None
            if axis is not None:
                text = f"a{axis}{'+' if self._raw.axes[axis] > self._rest[axis] else '-'}"
                text = None if text in self._found.texts else text
            if text is not None:
                self._found.buttons[name] = Binding(text)
                yield from self._take(text)
                return
            if needed:
                self._check_patience(began, name)
            elif self._clock() - began > OPTIONAL_S:
                self._ask(f"{label(name)} is left out")
                return

    def _take(self, text: str) -> Iterator[None]:
        self._found.texts.add(text)
        yield from self._let_go()

    def _let_go(self) -> Iterator[None]:
        while self._raw.pressed or self._moved(STIRRED, tuple(self._rest), taken=True) is not None:
            yield

    def _moved(self, by: float, rest: tuple[float, ...], *, taken: bool = False) -> int | None:
        """The axis that is farthest from its rest by at least so much; ``taken``: among all, not only those left."""
        away = {k: abs(a - b) for k, (a, b) in enumerate(zip(self._raw.axes, rest, strict=True))}
        left = [k for k in away if away[k] > by and (taken or k not in self._found.axes)]
        return max(left, key=away.__getitem__, default=None)

    def _fresh(self) -> str | None:
        """A button that is pressed and stands for nothing yet."""
        return next(iter(sorted(self._raw.pressed - self._found.texts)), None)

    def _check_patience(self, began: float, name: str) -> None:
        if self._clock() - began > REQUIRED_S:
            raise LayflatError(f"nothing came for {name.replace('_', ' ')} in {REQUIRED_S:.0f} s; nothing was written")
