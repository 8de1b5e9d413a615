"""Every teleoperator by its name. A new one adds a file and a line here."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from layflat.app.support.errors import LayflatError
from layflat.app.workstation.teleop.gamepad import Gamepad
from layflat.app.workstation.teleop.keyboard import TerminalKeyboard, WindowKeyboard
from layflat.app.workstation.teleop.mouse import HandGuidingTeleoperator, Mouse, Ray
from layflat.app.workstation.teleop.teleoperator import CombinedInput, Teleoperator, WindowTeleoperator
from layflat.data.arrays import FloatArray
from layflat.data.robot import RobotSpec

IN_TERMINAL = ("gamepad", "keyboard")
"""Teleoperators that work without a window."""
TELEOPERATORS = (*IN_TERMINAL, "mouse", "kinesthetic")


def usable_source(name: str, robot: RobotSpec, *, mapping: Path | None = None) -> tuple[str, str]:
    """Return the teleoperator to use, and one sentence where that is the keyboard instead of a missing gamepad."""
    if name != "gamepad":
        return name, ""
    gamepad = Gamepad(robot, mapping=mapping, own_events=False)
    newest = gamepad.poll()
    gamepad.close()
    if newest.connected:
        return name, ""
    return "keyboard", f"{newest.problem.partition(';')[0]}; the keyboard is used instead"


def make_terminal_teleoperator(name: str, robot: RobotSpec, *, mapping: Path | None = None) -> Teleoperator:
    """Make a teleoperator that needs no window; LayflatError where its device is missing."""
    if name == "keyboard":
        return TerminalKeyboard(robot)
    gamepad = Gamepad(robot, mapping=mapping)
    newest = gamepad.poll()
    if not newest.connected:
        gamepad.close()
        raise LayflatError(newest.problem.replace("use the keyboard", "use --source keyboard"))
    return CombinedInput(gamepad, TerminalKeyboard(robot)) if sys.stdin and sys.stdin.isatty() else gamepad


def make_window_teleoperator(
    name: str,
    robot: RobotSpec,
    *,
    ray: Ray,
    corners: Callable[[], FloatArray],
    mapping: Path | None = None,
    scale: Callable[[], float] = lambda: 1.0,
) -> WindowTeleoperator:
    """Make a teleoperator that is given the window's events; a missing device is a problem of its inputs.

    ``ray`` and ``corners`` are for `HandGuidingTeleoperator`, ``mapping`` for gamepads, ``scale`` for `Mouse`.
    """
    if name == "gamepad":
        return Gamepad(robot, mapping=mapping, own_events=False)
    if name == "keyboard":
        return WindowKeyboard(robot)
    return Mouse(robot, scale) if name == "mouse" else HandGuidingTeleoperator(robot, ray, corners)
