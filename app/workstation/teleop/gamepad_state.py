"""State of a gamepad in the words of a PS4's: sticks, triggers and buttons, however its maker names them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

STICKS = ("left_x", "left_y", "right_x", "right_y")
TRIGGERS = ("l2", "r2")
BUTTONS = (
    *("cross", "circle", "square", "triangle", "share", "ps", "options", "l3", "r3", "l1", "r1"),
    *("up", "down", "left", "right"),
)
"""In the order of SDL's controllers; the last four are the d-pad."""
LABELS = {"l1": "L1", "r1": "R1", "l3": "L3", "r3": "R3", "l2": "L2", "r2": "R2", "ps": "PS"}
"""Labels that are not just the name with a capital."""
DEAD_ZONE = 0.12
"""Share of a stick's way that counts as none: worn sticks rest up to 0.1 off the middle."""
DEAD_ZONE_MAX, MIDDLE_MAX = 0.9, 0.5


@dataclass(frozen=True, kw_only=True)
class StickRest:
    """Places at which a gamepad's sticks rest: worn ones not in the middle, and not always at the same place."""

    dead_zone: float = DEAD_ZONE
    """Share of a stick's way around its middle that counts as none."""
    middle: Mapping[str, float] = field(default_factory=dict)
    """Reading in -1..1 at rest, by name from STICKS; 0 where there is none."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.dead_zone <= DEAD_ZONE_MAX:
            raise ValueError(f"the dead zone is {self.dead_zone}; it must be within 0..{DEAD_ZONE_MAX}")
        if not all(name in STICKS and abs(value) <= MIDDLE_MAX for name, value in self.middle.items()):
            raise ValueError(f"the middle is {dict(self.middle)}; each of {', '.join(STICKS)} is within {MIDDLE_MAX}")

    def stick(self, side: str, raw: Mapping[str, float]) -> tuple[float, float]:
        """Return a stick's place outside its dead zone, right and up positive; -1 and 1 are still its ends."""
        at = []
        for name in (f"{side}_x", f"{side}_y"):
            middle = self.middle.get(name, 0.0)
            at.append((raw[name] - middle) / (1.0 - middle if raw[name] > middle else 1.0 + middle))
        return dead_zone(at[0], -at[1], dead=self.dead_zone)


@dataclass(frozen=True, kw_only=True)
class GamepadState:
    """One moment of a gamepad."""

    left: tuple[float, float] = (0.0, 0.0)
    """Left stick outside its dead zone: to the right, up; length at most 1."""
    right: tuple[float, float] = (0.0, 0.0)
    """Right stick likewise."""
    l2: float = 0.0
    """Trigger: 0 released, 1 pulled."""
    r2: float = 0.0
    """Trigger likewise."""
    pressed: frozenset[str] = frozenset()
    """Names from BUTTONS."""


def dead_zone(x: float, y: float, *, dead: float = DEAD_ZONE) -> tuple[float, float]:
    """Map a stick's raw place, each within -1..1, to the same direction with a length of 0..1.

    The rest of the way is stretched to the whole, so that slow motion just outside the dead zone stays possible.
    """
    length = math.hypot(x, y)
    if length <= dead:
        return 0.0, 0.0
    scale = min((length - dead) / (1.0 - dead), 1.0) / length
    return x * scale, y * scale


def label(button: str) -> str:
    """Return the name of a button or a trigger for a person."""
    return LABELS.get(button, f"d-pad {button}" if button in BUTTONS[-4:] else button.capitalize())


def make_state(
    sticks: Mapping[str, float], triggers: Mapping[str, float], pressed: Iterable[str], rest: StickRest
) -> GamepadState:
    """Make a state of raw sticks (-1..1, down is positive) and triggers (0..1)."""
    left, right = rest.stick("left", sticks), rest.stick("right", sticks)
    pulled = {name: min(max(triggers[name], 0.0), 1.0) for name in TRIGGERS}
    return GamepadState(left=left, right=right, pressed=frozenset(pressed), **pulled)
