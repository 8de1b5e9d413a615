"""Every source by name. A new one adds a file and a line here."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from layflat.app.support.errors import LayflatError
from layflat.app.workstation.teleop.combined_input import CombinedInput
from layflat.app.workstation.teleop.gamepad import Gamepad
from layflat.app.workstation.teleop.hand_guiding import HandGuidingTeleoperator, Ray
from layflat.app.workstation.teleop.mouse import Mouse
from layflat.app.workstation.teleop.teleoperator import Teleoperator, WindowTeleoperator
from layflat.app.workstation.teleop.terminal_keyboard import TerminalKeyboard
from layflat.app.workstation.teleop.window_keyboard import WindowKeyboard
from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec


@dataclass(frozen=True)
class TeleoperatorSpec:
    """What there is to know of a source before it is made."""

    does: str
    """For a person who chooses."""
    terminal: bool
    """Whether it works without a window."""


TELEOPERATORS: Mapping[str, TeleoperatorSpec] = {
    "gamepad": TeleoperatorSpec("a PS4 pad, or any that SDL knows or that was calibrated", terminal=True),
    "keyboard": TeleoperatorSpec("keys, in the window or in a plain terminal", terminal=True),
    "mouse": TeleoperatorSpec("drag in the window: how far from where you began is how fast", terminal=False),
    "kinesthetic": TeleoperatorSpec("drag the hanger itself, with the arm compliant", terminal=False),
}


def terminal_source(name: str, robot: RobotSpec, *, mapping: Path | None = None) -> Teleoperator:
    """A source that needs no window. LayflatError where its device is missing."""
    if name == "keyboard":
        return TerminalKeyboard(robot)
    pad = Gamepad(robot, mapping=mapping)
    reading = pad.poll()
    if not reading.connected:
        pad.close()
        raise LayflatError(reading.problem)
    return CombinedInput(pad, TerminalKeyboard(robot)) if sys.stdin and sys.stdin.isatty() else pad


def window_source(
    name: str, robot: RobotSpec, *, ray: Ray, corners: Callable[[], FloatArray], mapping: Path | None = None
) -> WindowTeleoperator:
    """A source that hears of the window's events; one whose device is missing says so in its readings.

    ``ray`` and ``corners`` are for what is taken hold of with the mouse, see HandGuidingTeleoperator.
    """
    made: Mapping[str, Callable[[], WindowTeleoperator]] = {
        "gamepad": lambda: Gamepad(robot, mapping=mapping, own_events=False),
        "keyboard": lambda: WindowKeyboard(robot),
        "mouse": lambda: Mouse(robot),
        "kinesthetic": lambda: HandGuidingTeleoperator(robot, ray, corners),
    }
    return made[name]()
