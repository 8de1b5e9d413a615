"""State of a gamepad in the words of a PS4's: sticks, triggers and buttons, however its maker names them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

STICKS = ("left_x", "left_y", "right_x", "right_y")
TRIGGERS = ("l2", "r2")
BUTTONS = (
    *("cross", "circle", "square", "triangle", "share", "ps", "options", "l3", "r3", "l1", "r1"),
    *("up", "down", "left", "right"),
)
"""In the order of SDL's controllers; the last four are the d-pad."""
LABELS = {"l1": "L1", "r1": "R1", "l3": "L3", "r3": "R3", "ps": "PS", "up": "d-pad up"}
"""Labels that are not just the name with a capital."""

DEAD_ZONE = 0.12
"""Share of a stick's way that counts as none: worn sticks rest up to 0.1 off the middle."""


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
    """Return the name of a button for a person."""
    return LABELS.get(button, button.capitalize())


def make_state(sticks: dict[str, float], triggers: dict[str, float], pressed: Iterable[str]) -> GamepadState:
    """Make a state of raw sticks (-1..1, down is positive) and triggers (0..1)."""
    return GamepadState(
        left=dead_zone(sticks["left_x"], -sticks["left_y"]),
        right=dead_zone(sticks["right_x"], -sticks["right_y"]),
        l2=min(max(triggers.get("l2", 0.0), 0.0), 1.0),
        r2=min(max(triggers.get("r2", 0.0), 0.0), 1.0),
        pressed=frozenset(pressed),
    )
